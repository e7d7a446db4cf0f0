#include "server/film/unit_layout.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <optional>
#include <string_view>
#include <tuple>
#include <utility>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "filter/image/decisions.h"
#include "filter/image/edged_image.h"
#include "filter/image/layers.h"
#include "proto/rpc/limits.h"
#include "server/job/plan.h"

namespace lumifold::film {
namespace {

using layers::Level;

/// All whole numbers below are floats.
constexpr float kEndOfNumbers = 0x1p24f;

std::array<std::vector<std::string>, layers::kLevelCount> MakeLevelChannels(v1::UnitKind kind, bool lens) {
  std::array<std::vector<std::string>, layers::kLevelCount> names;
  for (size_t i = 0; i < names.size(); ++i) {
    names[i] = kind == v1::UNIT_KIND_GEOMETRY ? layers::LevelFeatureChannels(Level::Of(i))
                                              : layers::LevelPassChannels(Level::Of(i), lens);
  }
  return names;
}

/// Channels that a unit of this kind has for each of its levels.
const std::vector<std::string>& LevelChannels(v1::UnitKind kind, size_t level, bool lens) {
  static const auto& of_passes = *new auto(MakeLevelChannels(v1::UNIT_KIND_PASS, false));
  static const auto& of_lens = *new auto(MakeLevelChannels(v1::UNIT_KIND_PASS, true));
  static const auto& of_geometry = *new auto(MakeLevelChannels(v1::UNIT_KIND_GEOMETRY, false));
  return (kind == v1::UNIT_KIND_GEOMETRY ? of_geometry : lens ? of_lens : of_passes)[level];
}

/// The channel names of a picture, to be looked up.
class NameSet {
 public:
  template <typename Names>
  explicit NameSet(const Names& names) : sorted_(names.begin(), names.end()) {
    std::sort(sorted_.begin(), sorted_.end());
  }

  bool Has(std::string_view name) const { return std::binary_search(sorted_.begin(), sorted_.end(), name); }
  absl::Status CheckEachOnce(const std::vector<std::string>& names) const {
    for (const std::string_view name : names) {
      const auto [first, last] = std::equal_range(sorted_.begin(), sorted_.end(), name);
      if (last - first == 1) continue;
      return absl::InvalidArgumentError(
          absl::StrCat("unit: channel ", std::string(name), " is missing or appears twice"));
    }
    return absl::OkStatus();
  }

 private:
  std::vector<std::string_view> sorted_;
};

LevelSet LevelsIn(v1::UnitKind kind, const NameSet& names) {
  LevelSet levels;
  for (size_t i = 0; i < levels.size(); ++i) levels[i] = names.Has(LevelChannels(kind, i, false).front());
  return levels;
}

/// Whether one of kCount values is NaN or infinite: its exponent has all bits set. The count is a constant,
/// so that the compiler vectorises the loop.
template <size_t kCount>
bool HasNotFinite(const char* values) {
  constexpr uint32_t kExponent = 0x7f800000;
  std::array<uint32_t, kCount> all_bits;
  std::memcpy(all_bits.data(), values, sizeof(all_bits));
  uint32_t found = 0;
  for (const uint32_t bits : all_bits) found |= (bits & kExponent) == kExponent ? 1u : 0u;
  return found != 0;
}

bool IsFiniteRow(std::string_view row) {
  constexpr size_t kBlock = 16;
  for (; row.size() >= kBlock * sizeof(float); row.remove_prefix(kBlock * sizeof(float))) {
    if (HasNotFinite<kBlock>(row.data())) return false;
  }
  for (; !row.empty(); row.remove_prefix(sizeof(float))) {
    if (HasNotFinite<1>(row.data())) return false;
  }
  return true;
}

/// A value that is NaN or infinite.
struct NotFinite {
  std::string channel;
  int x = 0;
  int y = 0;
  float value = 0;
};

/// Rows are read together up to this many values.
constexpr int kValuesAtOnce = 1024;

/// Adds a row that is repeated.
void AddRepeatedly(std::string_view row, int times, rpc::RunningChecksum* checksum) {
  const int at_once =
      std::max(1, kValuesAtOnce * static_cast<int>(sizeof(float)) / static_cast<int>(row.size()));
  std::string rows;
  for (int i = 0; i < std::min(at_once, times); ++i) rows += row;
  for (int left = times; left > 0; left -= at_once)
    checksum->Add(
        std::string_view(rows).substr(0, row.size() * static_cast<size_t>(std::min(at_once, left))));
}

/// The first such value of a picture; nullopt if all are finite. Adds the values before it to `checksum`,
/// which may be null.
/// Errors: that of PlaneRows::status.
absl::StatusOr<std::optional<NotFinite>> FindNotFinite(PlaneRows& planes, rpc::RunningChecksum* checksum) {
  const int at_once = std::max(1, kValuesAtOnce / planes.width());
  for (size_t plane = 0; plane < planes.names().size(); ++plane) {
    const int distinct = planes.DistinctRows(plane);
    std::string_view rows;
    for (int y = 0; y < distinct; y += at_once) {
      rows = planes.Rows(plane, y, std::min(at_once, distinct - y));
      if (!planes.status().ok()) return planes.status();
      if (!IsFiniteRow(rows)) {
        int i = 0;
        while (std::isfinite(ValueAt(rows, i))) ++i;
        return NotFinite{std::string(planes.names()[plane]), i % planes.width(), y + i / planes.width(),
                         ValueAt(rows, i)};
      }
      if (checksum != nullptr) checksum->Add(rows);
    }
    if (checksum == nullptr || distinct == planes.height()) continue;
    const size_t row_bytes = static_cast<size_t>(planes.width()) * sizeof(float);
    AddRepeatedly(rows.substr(rows.size() - row_bytes), planes.height() - distinct, checksum);
  }
  return std::nullopt;
}

/// Number of samples of one half in `samples`: even indices belong to half A, odd ones to half B.
uint32_t SamplesOfHalf(SampleRange samples, size_t half) {
  const auto before = [half](uint32_t index) { return half == 0 ? index / 2 + index % 2 : index / 2; };
  return before(samples.last) - before(samples.first);
}

/// The count itself if it is a whole number from 0 to `most`; otherwise, also for NaN, another number.
int32_t WholeNumber(float count, float most) {
  return static_cast<int32_t>(std::min(std::max(0.0f, count), most));
}

/// Most samples of one half in each pixel of a tile.
struct CountLimits {
  const TileSamples& samples;
  size_t half;
  uint32_t At(int x, int y) const { return SamplesOfHalf(samples.At(x, y), half); }
};

/// Checks the sample counts of pixels [begin, end) of a row, which have one limit. Returns their sum; nullopt
/// if one is not valid.
std::optional<int64_t> SumOfRun(std::string_view row, int begin, int end, uint32_t most) {
  const auto limit = static_cast<float>(most);
  int64_t sum = 0;
  bool valid = true;
  for (int x = begin; x < end; ++x) {
    const int32_t count = WholeNumber(ValueAt(row, x), limit);
    valid &= static_cast<float>(count) == ValueAt(row, x);
    sum += count;
  }
  return valid ? std::optional(sum) : std::nullopt;
}

/// Checks the sample counts of one channel and returns their sum.
absl::StatusOr<int64_t> SumOfCounts(PlaneRows& planes, size_t plane, const Rect& rect,
                                    const CountLimits& limits) {
  const bool is_uniform = limits.samples.IsUniform();
  const int rows = is_uniform ? planes.DistinctRows(plane) : planes.height();
  const int run = is_uniform ? planes.width() : kSampleBlock;
  int64_t sum = 0;
  for (int y = 0; y < rows; ++y) {
    const std::string_view row = planes.Row(plane, y);
    for (int begin = 0; begin < planes.width(); begin += run) {
      const uint32_t most = limits.At(begin, y);
      const std::optional<int64_t> part = SumOfRun(row, begin, std::min(begin + run, planes.width()), most);
      if (part.has_value()) {
        sum += *part;
        continue;
      }
      int x = begin;
      while (SumOfRun(row, x, x + 1, most).has_value()) ++x;
      return absl::InvalidArgumentError(absl::StrCat("unit: ", std::string(planes.names()[plane]), " is ",
                                                     ValueAt(row, x), " at ", rect.x0 + x, ",", rect.y0 + y,
                                                     ", not a whole number from 0 to ", most));
    }
  }
  return sum * (planes.height() / rows);
}

/// Checks the sample counts of a pass, and those of its levels.
absl::Status CheckCounts(const Rect& rect, const TileSamples& samples, PlaneRows& pixels,
                         int64_t bad_samples) {
  int64_t added = 0;
  for (size_t half = 0; half < 2; ++half) {
    const std::string_view base = half == 0 ? layers::kSamplesA : layers::kSamplesB;
    const CountLimits limits{samples, half};
    const absl::StatusOr<int64_t> sum = SumOfCounts(pixels, *pixels.Find(base), rect, limits);
    if (!sum.ok()) return sum.status();
    added += *sum;
    for (size_t i = 0; i < layers::kLevelCount; ++i) {
      const std::optional<size_t> plane = pixels.Find(layers::OfLevel(Level::Of(i), base));
      if (!plane.has_value()) continue;
      const absl::StatusOr<int64_t> of_level = SumOfCounts(pixels, *plane, rect, limits);
      if (!of_level.ok()) return of_level.status();
    }
  }
  const int64_t all = samples.CountIn(rect.width(), rect.height());
  if (added == all - bad_samples) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat("unit: has ", added, " samples and ", bad_samples, " bad ones, but its pass has ", all));
}

/// A matrix of a camera, or none.
bool IsMatrix(const google::protobuf::RepeatedField<float>& values) {
  return values.empty() || (values.size() == 16 && std::all_of(values.begin(), values.end(),
                                                               [](float v) { return std::isfinite(v); }));
}

absl::Status CheckFacts(const v1::UnitStats& stats) {
  if (!IsMatrix(stats.camera().world_to_camera()) || !IsMatrix(stats.camera().world_to_ndc()))
    return absl::InvalidArgumentError("unit: its camera has a matrix that is not 16 finite numbers");
  size_t bytes = 0;
  for (const v1::SceneObject& object : stats.objects())
    bytes += object.name().size() + object.material().size();
  if (stats.objects_size() <= static_cast<int>(rpc::kMaxObjects) && bytes <= rpc::kMaxObjectBytes)
    return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat("unit: names ", stats.objects_size(), " objects with ", bytes, " bytes: too many"));
}

absl::Status CheckStats(const v1::UnitStats& stats) {
  if (absl::Status status = CheckFacts(stats); !status.ok()) return status;
  if (stats.samples() >= 0 && stats.bad_samples() >= 0 && stats.rays() >= 0 &&
      std::isfinite(stats.seconds()) && stats.seconds() >= 0)
    return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(
      "unit: its statistics are ", stats.samples(), " samples, ", stats.bad_samples(), " bad samples, ",
      stats.rays(), " rays and ", stats.seconds(), " seconds: one is negative or not finite"));
}

absl::Status CannotRead(const char* part, const absl::Status& cause) {
  return absl::InvalidArgumentError(absl::StrCat(part, ": ", std::string(cause.message())));
}

/// What a list is called in errors, its channels and its width.
struct ListForm {
  const char* name;
  const std::vector<std::string>& channels;
  int width;
};

/// Checks channels, width, and that all values are finite. Adds them to `checksum`, which may be null.
absl::Status CheckForm(const ListForm& form, PlaneRows& list, rpc::RunningChecksum* checksum) {
  if (absl::Status status = NameSet(list.names()).CheckEachOnce(form.channels); !status.ok()) return status;
  if (list.width() != form.width || list.names().size() != form.channels.size()) {
    return absl::InvalidArgumentError(absl::StrCat(form.name, ": ", list.width(), " columns of ",
                                                   list.names().size(), " channels, expected ", form.width,
                                                   " of ", form.channels.size()));
  }
  const absl::StatusOr<std::optional<NotFinite>> found = FindNotFinite(list, checksum);
  if (!found.ok()) return CannotRead(form.name, found.status());
  if (const std::optional<NotFinite>& bad = *found; bad.has_value()) {
    return absl::InvalidArgumentError(
        absl::StrCat(form.name, ": ", bad->channel, " of row ", bad->y, " is ", bad->value, ", not finite"));
  }
  return absl::OkStatus();
}

/// A coordinate of the pixel of a row of an edge set.
struct Coordinate {
  float value = 0;
  bool is_common = true;  // all sub-samples have it
};

/// The coordinates of all rows: plane by plane, because a plane may be compressed.
std::vector<Coordinate> CoordinatesOf(PlaneRows& edges, std::string_view channel) {
  const size_t plane = *edges.Find(channel);
  std::vector<Coordinate> coordinates(static_cast<size_t>(edges.height()));
  for (int row = 0; row < edges.height(); ++row) {
    const std::string_view values = edges.Row(plane, row);
    Coordinate& coordinate = coordinates[static_cast<size_t>(row)];
    coordinate.value = ValueAt(values, 0);
    for (int i = 1; i < edges.width(); ++i) coordinate.is_common &= ValueAt(values, i) == coordinate.value;
  }
  return coordinates;
}

/// Whether a coordinate is that of one pixel in [begin, end).
bool IsOnePixelWithin(const Coordinate& coordinate, int begin, int end) {
  return coordinate.is_common && coordinate.value >= static_cast<float>(begin) &&
         coordinate.value < static_cast<float>(end) && coordinate.value == std::floor(coordinate.value);
}

/// Checks the pixels of an edge set, by row.
absl::Status CheckPlaces(const Rect& rect, const std::vector<Coordinate>& xs,
                         const std::vector<Coordinate>& ys) {
  std::pair<float, float> last = {-1.0f, -1.0f};
  for (size_t row = 0; row < xs.size(); ++row) {
    const Coordinate& x = xs[row];
    const Coordinate& y = ys[row];
    const std::pair pixel(y.value, x.value);
    if (!IsOnePixelWithin(x, rect.x0, rect.x1) || !IsOnePixelWithin(y, rect.y0, rect.y1) || pixel <= last) {
      return absl::InvalidArgumentError(absl::StrCat("edge set: the pixel ", x.value, ",", y.value,
                                                     " of row ", row,
                                                     " is outside the tile, out of order or ambiguous"));
    }
    last = pixel;
  }
  return absl::OkStatus();
}

/// The values of a list that is 1 wide.
std::vector<float> ColumnOf(PlaneRows& list, std::string_view channel) {
  if (list.height() == 0) return {};
  const size_t plane = *list.Find(channel);
  const std::string_view rows = list.Rows(plane, 0, list.DistinctRows(plane));
  std::vector<float> values(rows.size() / sizeof(float));
  std::memcpy(values.data(), rows.data(), rows.size());
  values.resize(static_cast<size_t>(list.height()), values.back());
  return values;
}

bool IsWholeWithin(float value, float begin, float end) {
  return value >= begin && value < end && value == std::floor(value);
}

/// Checks the pixels and surfaces of fragments, by row.
absl::Status CheckFragmentPlaces(const Rect& rect, PlaneRows& fragments) {
  const std::vector<float> xs = ColumnOf(fragments, layers::kPixelX);
  const std::vector<float> ys = ColumnOf(fragments, layers::kPixelY);
  const std::vector<float> surfaces = ColumnOf(fragments, layers::kSurface);
  int of_pixel = 0;
  for (size_t row = 0; row < xs.size(); ++row) {
    const bool is_inside = IsWholeWithin(xs[row], static_cast<float>(rect.x0), static_cast<float>(rect.x1)) &&
                           IsWholeWithin(ys[row], static_cast<float>(rect.y0), static_cast<float>(rect.y1));
    const bool is_ordered = row == 0 || std::tie(ys[row - 1], xs[row - 1], surfaces[row - 1]) <
                                            std::tie(ys[row], xs[row], surfaces[row]);
    const bool continues = row > 0 && xs[row] == xs[row - 1] && ys[row] == ys[row - 1];
    of_pixel = continues ? of_pixel + 1 : 1;
    if (is_inside && is_ordered && IsWholeWithin(surfaces[row], 1, kEndOfNumbers) &&
        of_pixel <= kMaxFragments)
      continue;
    return absl::InvalidArgumentError(
        absl::StrCat("fragments: row ", row, " is surface ", surfaces[row], " of the pixel ", xs[row], ",",
                     ys[row], ": outside the tile, out of order, no surface, or one too many"));
  }
  return absl::OkStatus();
}

}  // namespace

UnitModel ModelOf(const v1::JobSpec& spec) {
  const auto is_on = [&spec](std::string_view decision) { return job::ValueOf(spec, decision) != 0; };
  return {.carried = {.direct = is_on(decisions::kDirect),
                      .indirect = is_on(decisions::kIndirect),
                      .albedo = is_on(decisions::kAlbedo),
                      .emission = is_on(decisions::kEmission),
                      .glossy = is_on(decisions::kGlossy),
                      .lens = spec.has_lens()},
          .levels = job::ValueOf(spec, decisions::kLevels),
          .has_matte = spec.background() == v1::BACKGROUND_TRANSPARENT};
}

std::vector<std::string> PassChannels(const UnitModel& model) {
  std::vector<std::string> names;
  const auto add_color = [&names](std::string_view layer) {
    for (const std::string& name : layers::ColorChannels(layer)) names.push_back(name);
  };
  const auto add_halves = [&](std::string_view layer) {
    add_color(layers::HalfA(layer));
    add_color(layers::HalfB(layer));
  };
  for (const std::string_view layer : layers::kHalved) {
    if (model.Has(layer)) add_halves(layer);
  }
  for (const std::string_view layer : layers::kWhole) {
    if (!model.Has(layer)) continue;
    if (model.carried.lens) {
      add_halves(layer);
    } else {
      add_color(layer);
    }
  }
  names.emplace_back(layers::kSamplesA);
  names.emplace_back(layers::kSamplesB);
  if (model.has_matte) names.insert(names.end(), layers::kMatte.begin(), layers::kMatte.end());
  return names;
}

std::vector<std::string> PassFragmentChannels(const UnitModel& model) {
  return layers::FragmentChannels([&model](std::string_view layer) { return model.Has(layer); });
}

std::vector<std::string> GeometryChannels(const UnitModel& model) {
  std::vector<std::string> names;
  for (const std::string_view name :
       {layers::kNormalX, layers::kNormalY, layers::kNormalZ, layers::kDistance, layers::kMask,
        layers::kObjectId, layers::kPlanarDepth, layers::kRoughness, layers::kAlpha})
    names.emplace_back(name);
  if (model.carried.lens) names.emplace_back(layers::kBlur);
  return names;
}

LevelSet LevelsOf(v1::UnitKind kind, const v1::PixelLayout& layout) {
  return LevelsIn(kind, NameSet(layout.channels()));
}

rpc::PixelLimits UnitLimits(const Rect& rect) {
  rpc::PixelLimits limits;
  limits.max_width = rect.width();
  limits.max_height = rect.height();
  const size_t of_levels = layers::kLevelCount * layers::LevelPassChannels(Level{}, true).size();
  UnitModel most;
  most.has_matte = true;
  most.carried.lens = true;
  limits.max_channels = static_cast<int>(PassChannels(most).size() + of_levels);
  return limits;
}

rpc::PixelLimits ListLimits(v1::UnitKind kind, const Rect& rect) {
  const bool is_pass = kind == v1::UNIT_KIND_PASS;
  rpc::PixelLimits limits;
  limits.max_width = is_pass ? 1 : kSubSamples;
  limits.max_height = rect.width() * rect.height() * (is_pass ? kMaxFragments : 1);
  limits.max_channels = static_cast<int>((is_pass ? PassFragmentChannels() : layers::EdgeChannels()).size());
  return limits;
}

absl::Status CheckUnitLayout(v1::UnitKind kind, const Rect& rect, const v1::PixelLayout& layout,
                             const UnitModel& model) {
  if (layout.width() != rect.width() || layout.height() != rect.height()) {
    return absl::InvalidArgumentError(absl::StrCat("unit: size ", layout.width(), "x", layout.height(),
                                                   ", but the tile is ", rect.width(), "x", rect.height()));
  }
  const NameSet names(layout.channels());
  const std::vector<std::string> wanted =
      kind == v1::UNIT_KIND_GEOMETRY ? GeometryChannels(model) : PassChannels(model);
  if (absl::Status status = names.CheckEachOnce(wanted); !status.ok()) return status;
  size_t expected = wanted.size();
  const LevelSet levels = LevelsIn(kind, names);
  for (size_t i = 0; i < levels.size(); ++i) {
    if (!levels[i]) continue;
    if (Level::Of(i).depth > model.levels) {
      return absl::InvalidArgumentError(absl::StrCat("unit: has the level ", NameOf(Level::Of(i)),
                                                     ", but its job plans ", model.levels, " levels"));
    }
    const std::vector<std::string>& of_level = LevelChannels(kind, i, model.carried.lens);
    if (absl::Status status = names.CheckEachOnce(of_level); !status.ok()) return status;
    expected += of_level.size();
  }
  if (layout.channels_size() != static_cast<int>(expected)) {
    return absl::InvalidArgumentError(
        absl::StrCat("unit: ", layout.channels_size(), " channels, expected ", expected));
  }
  return absl::OkStatus();
}

absl::Status CheckUnitValues(v1::UnitKind kind, const Rect& rect, const TileSamples& samples,
                             PlaneRows pixels, const v1::UnitStats& stats, rpc::RunningChecksum* checksum) {
  if (absl::Status status = CheckStats(stats); !status.ok()) return status;
  const absl::StatusOr<std::optional<NotFinite>> found = FindNotFinite(pixels, checksum);
  if (!found.ok()) return CannotRead("unit", found.status());
  if (const std::optional<NotFinite>& bad = *found; bad.has_value()) {
    return absl::InvalidArgumentError(absl::StrCat("unit: ", bad->channel, " is ", bad->value, " at ",
                                                   rect.x0 + bad->x, ",", rect.y0 + bad->y, ", not finite"));
  }
  if (kind == v1::UNIT_KIND_GEOMETRY) return absl::OkStatus();
  return CheckCounts(rect, samples, pixels, stats.bad_samples());
}

absl::Status CheckEdges(const Rect& rect, PlaneRows edges, rpc::RunningChecksum* checksum) {
  if (edges.names().empty()) return absl::OkStatus();
  static const auto& wanted = *new std::vector<std::string>(layers::EdgeChannels());
  const ListForm form = {"edge set", wanted, kSubSamples};
  if (absl::Status status = CheckForm(form, edges, checksum); !status.ok()) return status;
  return CheckPlaces(rect, CoordinatesOf(edges, layers::kPixelX), CoordinatesOf(edges, layers::kPixelY));
}

absl::Status CheckFragments(const Rect& rect, const UnitModel& model, PlaneRows fragments,
                            rpc::RunningChecksum* checksum) {
  if (fragments.names().empty()) return absl::OkStatus();
  const std::vector<std::string> wanted = PassFragmentChannels(model);
  if (wanted.empty())
    return absl::InvalidArgumentError("fragments: the plan of the job has no light of surfaces");
  if (absl::Status status = CheckForm({"fragments", wanted, 1}, fragments, checksum); !status.ok())
    return status;
  if (absl::Status status = CheckFragmentPlaces(rect, fragments); !status.ok()) return status;
  const std::vector<float> a = ColumnOf(fragments, layers::kSamplesA);
  const std::vector<float> b = ColumnOf(fragments, layers::kSamplesB);
  for (size_t row = 0; row < a.size(); ++row) {
    if (IsWholeWithin(a[row], 0, kEndOfNumbers) && IsWholeWithin(b[row], 0, kEndOfNumbers) &&
        a[row] + b[row] > 0)
      continue;
    return absl::InvalidArgumentError(absl::StrCat("fragments: row ", row, " has ", a[row], " and ", b[row],
                                                   " samples, not whole numbers of which one is above 0"));
  }
  return absl::OkStatus();
}

absl::Status CheckFragmentCounts(const Rect& rect, PlaneRows fragments, PlaneRows pixels) {
  if (fragments.names().empty()) return absl::OkStatus();
  const std::vector<float> xs = ColumnOf(fragments, layers::kPixelX);
  const std::vector<float> ys = ColumnOf(fragments, layers::kPixelY);
  for (const std::string_view name : {layers::kSamplesA, layers::kSamplesB}) {
    const std::vector<float> counts = ColumnOf(fragments, name);
    const size_t plane = *pixels.Find(name);
    double sum = 0;
    for (size_t row = 0; row < counts.size(); ++row) {
      const bool continues = row > 0 && xs[row] == xs[row - 1] && ys[row] == ys[row - 1];
      sum = (continues ? sum : 0) + counts[row];
      const std::string_view of_pixels = pixels.Row(plane, static_cast<int>(ys[row]) - rect.y0);
      const float most = ValueAt(of_pixels, static_cast<int>(xs[row]) - rect.x0);
      if (sum <= most) continue;
      return absl::InvalidArgumentError(absl::StrCat("fragments: those at ", xs[row], ",", ys[row], " have ",
                                                     sum, " ", std::string(name), ", but the pixel has ",
                                                     most));
    }
  }
  return absl::OkStatus();
}

}  // namespace lumifold::film
