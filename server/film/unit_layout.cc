#include "server/film/unit_layout.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/image/layers.h"

namespace lumifold::film {
namespace {

using layers::Level;

std::vector<std::string> MakePassChannels() {
  std::vector<std::string> names;
  const auto add_color = [&names](std::string_view layer) {
    for (const std::string& name : layers::ColorChannels(layer)) names.push_back(name);
  };
  for (const std::string_view layer : layers::kHalved) {
    add_color(layers::HalfA(layer));
    add_color(layers::HalfB(layer));
  }
  for (const std::string_view layer : layers::kWhole) add_color(layer);
  names.emplace_back(layers::kSamplesA);
  names.emplace_back(layers::kSamplesB);
  return names;
}

int CountOf(const std::string& name, const v1::PixelLayout& layout) {
  return static_cast<int>(std::count(layout.channels().begin(), layout.channels().end(), name));
}

/// Channels that a unit of this kind has for each of its levels.
std::vector<std::string> LevelChannels(v1::UnitKind kind, Level level) {
  return kind == v1::UNIT_KIND_GEOMETRY ? layers::LevelFeatureChannels(level)
                                        : layers::LevelPassChannels(level);
}

absl::Status CheckEachOnce(const std::vector<std::string>& names, const v1::PixelLayout& layout) {
  for (const std::string& name : names) {
    if (CountOf(name, layout) != 1)
      return absl::InvalidArgumentError(absl::StrCat("unit: channel ", name, " is missing or appears twice"));
  }
  return absl::OkStatus();
}

}  // namespace

const std::vector<std::string>& PassChannels() {
  static const auto& names = *new std::vector<std::string>(MakePassChannels());
  return names;
}

const std::vector<std::string>& GeometryChannels() {
  static const auto& names = *new std::vector<std::string>{
      std::string(layers::kNormalX),     std::string(layers::kNormalY),   std::string(layers::kNormalZ),
      std::string(layers::kDistance),    std::string(layers::kMask),      std::string(layers::kObjectId),
      std::string(layers::kPlanarDepth), std::string(layers::kRoughness), std::string(layers::kAlpha)};
  return names;
}

LevelSet LevelsOf(v1::UnitKind kind, const v1::PixelLayout& layout) {
  LevelSet levels;
  for (size_t i = 0; i < levels.size(); ++i)
    levels[i] = CountOf(LevelChannels(kind, Level::Of(i)).front(), layout) > 0;
  return levels;
}

rpc::PixelLimits UnitLimits(const Rect& rect) {
  rpc::PixelLimits limits;
  limits.max_width = rect.width();
  limits.max_height = rect.height();
  const size_t of_levels = layers::kLevelCount * layers::LevelPassChannels(Level{}).size();
  limits.max_channels = static_cast<int>(PassChannels().size() + of_levels);
  return limits;
}

rpc::PixelLimits EdgeLimits(const Rect& rect) {
  rpc::PixelLimits limits;
  limits.max_width = kSubSamples;
  limits.max_height = rect.width() * rect.height();
  limits.max_channels = static_cast<int>(layers::EdgeChannels().size());
  return limits;
}

absl::Status CheckUnitLayout(v1::UnitKind kind, const Rect& rect, const v1::PixelLayout& layout) {
  if (layout.width() != rect.width() || layout.height() != rect.height()) {
    return absl::InvalidArgumentError(absl::StrCat("unit: size ", layout.width(), "x", layout.height(),
                                                   ", but the tile is ", rect.width(), "x", rect.height()));
  }
  const std::vector<std::string>& wanted =
      kind == v1::UNIT_KIND_GEOMETRY ? GeometryChannels() : PassChannels();
  if (absl::Status status = CheckEachOnce(wanted, layout); !status.ok()) return status;
  size_t expected = wanted.size();
  const LevelSet levels = LevelsOf(kind, layout);
  for (size_t i = 0; i < levels.size(); ++i) {
    if (!levels[i]) continue;
    const std::vector<std::string> of_level = LevelChannels(kind, Level::Of(i));
    if (absl::Status status = CheckEachOnce(of_level, layout); !status.ok()) return status;
    expected += of_level.size();
  }
  if (layout.channels_size() != static_cast<int>(expected)) {
    return absl::InvalidArgumentError(
        absl::StrCat("unit: ", layout.channels_size(), " channels, expected ", expected));
  }
  return absl::OkStatus();
}

absl::Status CheckEdges(const Rect& rect, const LayeredImage& edges) {
  if (edges.channels().empty()) return absl::OkStatus();
  const v1::PixelLayout layout = rpc::LayoutOf(edges);
  const std::vector<std::string> wanted = layers::EdgeChannels();
  if (absl::Status status = CheckEachOnce(wanted, layout); !status.ok()) return status;
  if (edges.width() != kSubSamples || edges.channels().size() != wanted.size()) {
    return absl::InvalidArgumentError(absl::StrCat("edge set: ", edges.width(), " sub-samples of ",
                                                   edges.channels().size(), " channels, expected ",
                                                   kSubSamples, " of ", wanted.size()));
  }
  std::pair<float, float> last = {-1.0f, -1.0f};
  for (int row = 0; row < edges.height(); ++row) {
    const float x = edges.Get(layers::kPixelX).At(0, row);
    const float y = edges.Get(layers::kPixelY).At(0, row);
    const bool is_within = x >= static_cast<float>(rect.x0) && x < static_cast<float>(rect.x1) &&
                           y >= static_cast<float>(rect.y0) && y < static_cast<float>(rect.y1);
    if (!is_within || std::pair(y, x) <= last) {
      return absl::InvalidArgumentError(absl::StrCat("edge set: the pixel ", x, ",", y, " of row ", row,
                                                     " is outside the tile or out of order"));
    }
    last = {y, x};
  }
  return absl::OkStatus();
}

}  // namespace lumifold::film
