#include "filter/denoise/settings.h"

#include <limits>

#include "filter/denoise/picture_size.h"

namespace lumifold::filter {

Settings DefaultSettings(int width, int height) {
  Settings settings;
  settings.layer.second_reach_px *= ReachScale(width, height);
  settings.products = {.sigma_normal = SigmaNormal(width, height),
                       .cuts_frame = true,
                       .has_levels = true,
                       .remainder_sees_levels = true};
  return settings;
}

Settings PublishedSettings() {
  Settings settings;
  settings.layer.single = SingleFilteringParams{};
  settings.max_antialiased_samples = std::numeric_limits<float>::infinity();
  return settings;
}

}  // namespace lumifold::filter
