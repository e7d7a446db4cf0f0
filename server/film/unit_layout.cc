#include "server/film/unit_layout.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <functional>
#include <optional>
#include <string_view>
#include <utility>

#include "absl/status/statusor.h"
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

/// Whether no value of a row is NaN or infinite. Compares bits, so that the compiler vectorises it.
bool IsFiniteRow(const float* row, int width) {
  constexpr int32_t kWithoutSign = 0x7fffffff;
  constexpr int32_t kInfinity = 0x7f800000;
  int32_t largest = 0;
  for (int x = 0; x < width; ++x) largest = std::max(largest, std::bit_cast<int32_t>(row[x]) & kWithoutSign);
  return largest < kInfinity;
}

/// A value that is NaN or infinite.
struct NotFinite {
  std::string channel;
  int x = 0;
  int y = 0;
  float value = 0;
};

/// The first such value of an image; nullopt if all are finite.
std::optional<NotFinite> FindNotFinite(const LayeredImage& image) {
  for (const LayeredImage::Channel& channel : image.channels()) {
    for (int y = 0; y < image.height(); ++y) {
      const float* row = channel.plane.Row(y);
      if (IsFiniteRow(row, image.width())) continue;
      const float* bad = std::find_if_not(row, row + image.width(), [](float v) { return std::isfinite(v); });
      return NotFinite{channel.name, static_cast<int>(bad - row), y, *bad};
    }
  }
  return std::nullopt;
}

/// Number of samples of one half in `samples`: even indices belong to half A, odd ones to half B.
uint32_t SamplesOfHalf(SampleRange samples, size_t half) {
  const auto before = [half](uint32_t index) { return half == 0 ? index / 2 + index % 2 : index / 2; };
  return before(samples.last) - before(samples.first);
}

/// Checks the sample counts of one channel and returns their sum.
absl::StatusOr<int64_t> SumOfCounts(const std::string& name, ConstFloatView counts, const Rect& rect,
                                    uint32_t most) {
  int64_t sum = 0;
  for (int y = 0; y < counts.height(); ++y) {
    for (int x = 0; x < counts.width(); ++x) {
      const float count = counts.At(x, y);
      const bool in_range = count >= 0 && count <= static_cast<float>(most);
      if (!in_range || count != std::floor(count)) {
        return absl::InvalidArgumentError(absl::StrCat("unit: ", name, " is ", count, " at ", rect.x0 + x,
                                                       ",", rect.y0 + y, ", not a whole number from 0 to ",
                                                       most));
      }
      sum += static_cast<int64_t>(count);
    }
  }
  return sum;
}

/// Checks the sample counts of a pass, and those of its levels.
absl::Status CheckCounts(const Rect& rect, SampleRange samples, const LayeredImage& pixels,
                         int64_t bad_samples) {
  int64_t added = 0;
  for (size_t half = 0; half < 2; ++half) {
    const std::string_view base = half == 0 ? layers::kSamplesA : layers::kSamplesB;
    const uint32_t most = SamplesOfHalf(samples, half);
    const absl::StatusOr<int64_t> sum = SumOfCounts(std::string(base), pixels.Get(base), rect, most);
    if (!sum.ok()) return sum.status();
    added += *sum;
    for (size_t i = 0; i < layers::kLevelCount; ++i) {
      const std::string name = layers::OfLevel(Level::Of(i), base);
      if (!pixels.Has(name)) continue;
      const absl::StatusOr<int64_t> of_level = SumOfCounts(name, pixels.Get(name), rect, most);
      if (!of_level.ok()) return of_level.status();
    }
  }
  const int64_t all = int64_t{rect.width()} * rect.height() * samples.count();
  if (added == all - bad_samples) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat("unit: has ", added, " samples and ", bad_samples, " bad ones, but its pass has ", all));
}

absl::Status CheckStats(const v1::UnitStats& stats) {
  if (stats.samples() >= 0 && stats.bad_samples() >= 0 && std::isfinite(stats.seconds()) &&
      stats.seconds() >= 0)
    return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat("unit: its statistics are ", stats.samples(), " samples, ",
                                                 stats.bad_samples(), " bad samples and ", stats.seconds(),
                                                 " seconds: one is negative or not finite"));
}

/// Whether all sub-samples of a row name the same pixel.
bool HasOnePixel(const LayeredImage& edges, int row) {
  for (const std::string_view name : {layers::kPixelX, layers::kPixelY}) {
    const float* values = edges.Get(name).Row(row);
    if (std::adjacent_find(values, values + kSubSamples, std::not_equal_to<>()) != values + kSubSamples)
      return false;
  }
  return true;
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

absl::Status CheckUnitValues(v1::UnitKind kind, const Rect& rect, SampleRange samples,
                             const LayeredImage& pixels, const v1::UnitStats& stats) {
  if (absl::Status status = CheckStats(stats); !status.ok()) return status;
  if (const std::optional<NotFinite> bad = FindNotFinite(pixels); bad.has_value()) {
    return absl::InvalidArgumentError(absl::StrCat("unit: ", bad->channel, " is ", bad->value, " at ",
                                                   rect.x0 + bad->x, ",", rect.y0 + bad->y, ", not finite"));
  }
  if (kind == v1::UNIT_KIND_GEOMETRY) return absl::OkStatus();
  return CheckCounts(rect, samples, pixels, stats.bad_samples());
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
  if (const std::optional<NotFinite> bad = FindNotFinite(edges); bad.has_value()) {
    return absl::InvalidArgumentError(
        absl::StrCat("edge set: ", bad->channel, " of row ", bad->y, " is ", bad->value, ", not finite"));
  }
  std::pair<float, float> last = {-1.0f, -1.0f};
  for (int row = 0; row < edges.height(); ++row) {
    const float x = edges.Get(layers::kPixelX).At(0, row);
    const float y = edges.Get(layers::kPixelY).At(0, row);
    const bool is_within = x >= static_cast<float>(rect.x0) && x < static_cast<float>(rect.x1) &&
                           y >= static_cast<float>(rect.y0) && y < static_cast<float>(rect.y1);
    if (!is_within || std::pair(y, x) <= last || x != std::floor(x) || y != std::floor(y) ||
        !HasOnePixel(edges, row)) {
      return absl::InvalidArgumentError(absl::StrCat("edge set: the pixel ", x, ",", y, " of row ", row,
                                                     " is outside the tile, out of order or ambiguous"));
    }
    last = {y, x};
  }
  return absl::OkStatus();
}

}  // namespace lumifold::film
