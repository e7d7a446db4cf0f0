#include "client/pictures/exposure.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string_view>
#include <vector>

#include "filter/image/color.h"

namespace lumifold::pictures {

float AutomaticExposure(const ConstColorView& linear, float white) {
  constexpr float kMiddleGrey = 0.18f;
  constexpr float kDark = 1e-4f;  // of the brightest pixel: what is darker counts as this
  std::vector<float> luminances;
  for (int y = 0; y < linear[0].height(); ++y) {
    for (int x = 0; x < linear[0].width(); ++x) {
      const float luminance = Luminance(linear[0].At(x, y), linear[1].At(x, y), linear[2].At(x, y));
      if (std::isfinite(luminance)) luminances.push_back(std::max(luminance, 0.0f));
    }
  }
  if (luminances.empty()) return 1;
  const auto bright = luminances.begin() + static_cast<ptrdiff_t>((luminances.size() - 1) * 9 / 10);
  std::nth_element(luminances.begin(), bright, luminances.end());
  const float limit = *bright;
  const float brightest = *std::max_element(bright, luminances.end());
  if (!(brightest > 0)) return 1;
  double sum = 0;
  for (const float luminance : luminances) sum += std::log(std::max(luminance, kDark * brightest));
  const double mean = std::exp(sum / static_cast<double>(luminances.size()));
  const auto exposure = static_cast<float>(static_cast<double>(kMiddleGrey) / mean);
  return limit > 0 ? std::min(exposure, white / limit) : exposure;
}

float WhiteOf(const char* view) {
  constexpr float kFilmicWhite = 5.6f;  // Filmic() of it is 1
  return std::string_view(view) == "filmic" ? kFilmicWhite : 1.0f;
}

}  // namespace lumifold::pictures
