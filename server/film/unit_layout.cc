#include "server/film/unit_layout.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "filter/image/layers.h"

namespace lumifold::film {
namespace {

std::vector<std::string> MakePassChannels() {
  std::vector<std::string> names;
  const auto add_color = [&names](std::string_view layer) {
    for (const std::string& name : layers::ColorChannels(layer)) names.push_back(name);
  };
  for (const std::string_view layer : layers::kHalved) {
    add_color(layers::HalfA(layer));
    add_color(layers::HalfB(layer));
  }
  add_color(layers::kAlbedo);
  add_color(layers::kEmission);
  names.emplace_back(layers::kSamplesA);
  names.emplace_back(layers::kSamplesB);
  return names;
}

}  // namespace

const std::vector<std::string>& PassChannels() {
  static const auto& names = *new std::vector<std::string>(MakePassChannels());
  return names;
}

const std::vector<std::string>& GeometryChannels() {
  static const auto& names = *new std::vector<std::string>{
      std::string(layers::kNormalX),  std::string(layers::kNormalY),     std::string(layers::kNormalZ),
      std::string(layers::kDistance), std::string(layers::kPlanarDepth), std::string(layers::kObjectId),
      std::string(layers::kMask),     std::string(layers::kAlpha)};
  return names;
}

rpc::PixelLimits UnitLimits(const Rect& rect) {
  rpc::PixelLimits limits;
  limits.max_width = rect.width();
  limits.max_height = rect.height();
  limits.max_channels = static_cast<int>(std::max(PassChannels().size(), GeometryChannels().size()));
  return limits;
}

absl::Status CheckUnitLayout(v1::UnitKind kind, const Rect& rect, const v1::PixelLayout& layout) {
  if (layout.width() != rect.width() || layout.height() != rect.height()) {
    return absl::InvalidArgumentError(absl::StrCat("unit: size ", layout.width(), "x", layout.height(),
                                                   " where the tile has ", rect.width(), "x", rect.height()));
  }
  const std::vector<std::string>& wanted =
      kind == v1::UNIT_KIND_GEOMETRY ? GeometryChannels() : PassChannels();
  for (const std::string& name : wanted) {
    if (std::count(layout.channels().begin(), layout.channels().end(), name) != 1) {
      return absl::InvalidArgumentError(absl::StrCat("unit: channel ", name, " is not there once"));
    }
  }
  if (layout.channels_size() != static_cast<int>(wanted.size())) {
    return absl::InvalidArgumentError(
        absl::StrCat("unit: ", layout.channels_size(), " channels where ", wanted.size(), " are due"));
  }
  return absl::OkStatus();
}

}  // namespace lumifold::film
