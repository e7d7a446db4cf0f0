#include "worker/render/geometry/geometry_unit.h"

#include <algorithm>
#include <array>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "filter/image/color.h"
#include "filter/image/layers.h"
#include "worker/render/geometry/edge_set.h"
#include "worker/render/tracing/pass_sums.h"

namespace lumifold::render {
namespace {

/// Sub-samples lie in the cells of a 4x4 grid.
constexpr int kGrid = 4;
static_assert(kGrid * kGrid == kSubSamples);

/// The sub-samples that are traced first: one in each row, column and quadrant of the grid. The same holds
/// for their lens points.
constexpr std::array<int, 4> kFirst = {0, 7, 9, 14};
/// The other sub-samples, which are traced in edge pixels.
constexpr std::array<int, 12> kOthers = {1, 2, 3, 4, 5, 6, 8, 10, 11, 12, 13, 15};
static_assert(kFirst.size() + kOthers.size() == kSubSamples);

/// Next to surfaces that emit more than white, sub-samples are refined: a slice of a lamp that all of them
/// miss has its radiance times its share of the pixel, which shows where the radiance is many times white.
constexpr float kBrightLuminance = 1;

/// How many rays a pixel of refined sub-samples has: the second number where E differs among the first ones
/// by more than kRefinedRange. The share of a lamp errs with n rays by about n^(-3/4): by an eighth of white
/// with 256 of them where E differs by 8.
constexpr std::array<uint32_t, 2> kFineRays = {256, 1024};
constexpr float kRefinedRange = 8;

/// The random numbers of ray i beside a lamp: points of a scrambled (0,2)-sequence in the pixel, of whose
/// first 4^k each cell of the grid has as many. A fixed pattern, however even, has lines that fall between
/// its points, and edges of all slopes occur: such a pixel has a wrong share of a lamp with any number of
/// samples. Scrambled anew in each pixel, the error has no sign in common.
Sampler SamplerOf(int64_t pixel, uint32_t i) {
  constexpr uint64_t kSeed = 0x66696e65;   // not that of any frame's samples
  return Sampler(kSeed, 0, pixel, 2 * i);  // those of one half
}

/// The sub-sample whose cell holds the point.
size_t CellOf(Vec2 point) {
  return static_cast<size_t>(point.y * kGrid) * kGrid + static_cast<size_t>(point.x * kGrid);
}

/// E summed over the rays of each cell, and its range in luminance.
struct FineEmission {
  std::array<Vec3, kSubSamples> sum = {};
  float least = std::numeric_limits<float>::infinity();
  float most = 0;

  void Add(size_t cell, const Vec3& emitted) {
    sum[cell] += emitted;
    const float luminance = Luminance(emitted.x, emitted.y, emitted.z);
    least = std::min(least, luminance);
    most = std::max(most, luminance);
  }
};

/// Where the ray of a sub-sample passes the lens: each cell of another 4x4 grid once, so that every row and
/// every column of sub-samples covers every row and every column of the lens grid (two orthogonal Latin
/// squares, from sums and products in the field of four elements). The grid is shifted anew in each pixel:
/// with one for all, what is out of focus would be seen sixteen times.
Vec2 LensPointOf(int64_t pixel, int sub_sample) {
  constexpr int kTwice[kGrid] = {0, 2, 3, 1};
  const int x = sub_sample % kGrid;
  const int y = sub_sample / kGrid;
  const int column = x ^ y;
  const int row = x ^ kTwice[y];
  const Vec2 shift = SamplerOf(pixel, 0).Get2D(kLensPair);
  const auto at = [](int cell, float offset) {
    const float point = static_cast<float>(cell) / kGrid + offset;
    return point < 1 ? point : point - 1;
  };
  return {at(column, shift.x), at(row, shift.y)};
}

/// The most frequent id, the lowest on ties; 0 for an empty list.
float MostFrequentId(std::vector<int> ids) {
  std::sort(ids.begin(), ids.end());
  int best = 0;
  std::ptrdiff_t best_count = 0;
  for (auto begin = ids.begin(); begin != ids.end();) {
    const auto end = std::upper_bound(begin, ids.end(), *begin);
    if (end - begin > best_count) {
      best = *begin;
      best_count = end - begin;
    }
    begin = end;
  }
  return static_cast<float>(best);
}

/// Means over the sub-samples that hit a surface, either the first one or that of one level.
struct SurfaceMeans {
  Vec3 normal;
  float distance = 0;
  float valid = 0;
  std::vector<int> ids;

  void Add(Vec3 unit_normal, float length, bool is_valid, int instance) {
    normal += unit_normal;
    distance += length;
    valid += is_valid ? 1.0f : 0.0f;
    ids.push_back(instance + 1);
  }

  /// In the order of layers::kLevelFeatures; `sub_samples` were traced.
  std::array<float, layers::kLevelFeatures.size()> Values(float sub_samples) const {
    const Vec3 n = LengthSquared(normal) > 0 ? Normalize(normal) : normal;
    return {
        n.x, n.y, n.z, distance / static_cast<float>(ids.size()), valid / sub_samples, MostFrequentId(ids)};
  }
};

/// The channels of a geometry unit.
class GeometryPicture {
 public:
  GeometryPicture(int width, int height, bool has_lens)
      : image_(width, height), levels_(width, height, layers::LevelFeatureChannels) {
    for (size_t i = 0; i < layers::kLevelFeatures.size(); ++i)
      surface_[i] = image_.Add(layers::kLevelFeatures[i]);
    planar_depth_ = image_.Add(layers::kPlanarDepth);
    roughness_ = image_.Add(layers::kRoughness);
    alpha_ = image_.Add(layers::kAlpha);
    if (has_lens) blur_ = image_.Add(layers::kBlur);
  }

  void Store(int x, int y, std::span<const GeometrySample> samples, const PictureCamera& camera) {
    const auto count = static_cast<float>(samples.size());
    if (!blur_.IsEmpty()) blur_.At(x, y) = LargestBlur(samples, camera);
    SurfaceMeans first;
    std::array<SurfaceMeans, layers::kLevelCount> levels;
    float planar_depth = 0;
    float roughness = 0;
    for (const GeometrySample& s : samples) {
      if (!s.hit) continue;
      first.Add(s.normal, s.distance, s.valid, s.instance);
      planar_depth += camera.PlanarDepth(s.position);
      roughness += s.roughness;
      s.levels.ForEach([&](layers::Level level, const LevelGeometry& g) {
        levels[level.index()].Add(g.normal, g.distance, g.valid, g.instance);
      });
    }
    if (first.ids.empty()) return;
    const auto hits = static_cast<float>(first.ids.size());
    const auto values = first.Values(count);
    for (size_t i = 0; i < values.size(); ++i) surface_[i].At(x, y) = values[i];
    planar_depth_.At(x, y) = planar_depth / hits;
    roughness_.At(x, y) = roughness / hits;
    alpha_.At(x, y) = hits / count;
    for (size_t i = 0; i < levels.size(); ++i) {
      if (!levels[i].ids.empty()) PutAll(levels[i].Values(count), x, y, &levels_.At(layers::Level::Of(i)));
    }
  }

  LayeredImage Take() {
    levels_.MoveTo(&image_);
    return std::move(image_);
  }

 private:
  static float LargestBlur(std::span<const GeometrySample> samples, const PictureCamera& camera) {
    float largest = 0;
    for (const GeometrySample& s : samples) {
      constexpr float kFar = std::numeric_limits<float>::infinity();
      largest = std::max(largest, camera.BlurAt(s.hit ? camera.PlanarDepth(s.position) : kFar));
    }
    return largest;
  }

  LayeredImage image_;
  LevelImages levels_;
  std::array<FloatView, layers::kLevelFeatures.size()> surface_;
  FloatView planar_depth_;
  FloatView roughness_;
  FloatView alpha_;
  FloatView blur_;  // empty: no lens
};

/// Goes over the pixels of a rectangle with the first samples of each. Keeps those of three rows, which the
/// edge test compares.
class PixelScan {
 public:
  struct Pixel {
    std::array<GeometrySample, kFirst.size()> samples;
    EdgeProbe probe;
    bool is_bright = false;  // a sample hits a surface that emits more than kBrightLuminance
  };

  /// What a pixel is among its neighbours.
  struct Place {
    bool is_edge = false;
    bool is_near_light = false;  // of an edge pixel: it or one of its neighbours is bright
  };

  PixelScan(const PathTracer& tracer, const PictureCamera& camera, const Rect& frame, const Rect& rect)
      : tracer_(tracer),
        camera_(camera),
        frame_(frame),
        rect_(rect),
        x0_(std::max(rect.x0 - 1, frame.x0)),
        x1_(std::min(rect.x1 + 1, frame.x1)) {}

  /// Calls visit(x, y, pixel, place) for each pixel in the order of rows.
  template <typename Visit>
  void ForEachPixel(const std::atomic<bool>* stop, Visit visit) const {
    Row above = ProbeRow(rect_.y0 - 1);
    Row here = ProbeRow(rect_.y0);
    for (int y = rect_.y0; y < rect_.y1; ++y) {
      if (stop != nullptr && stop->load(std::memory_order_relaxed)) break;
      Row below = ProbeRow(y + 1);
      for (int x = rect_.x0; x < rect_.x1; ++x) {
        const Pixel& pixel = here[static_cast<size_t>(x - x0_)];
        visit(x, y, pixel, PlaceOf(x, pixel, {&above, &here, &below}));
      }
      above = std::move(here);
      here = std::move(below);
    }
  }

  /// Traces some of a pixel's sub-samples.
  void Trace(int x, int y, std::span<const int> sub_samples, std::span<GeometrySample> out) const {
    TraceRays(out, [&](size_t i) { return RayOf(x, y, sub_samples[i]); });
  }

  /// Makes E of each sub-sample a mean over its cell. T stays that of its surface: fragments must not mix
  /// surfaces.
  void Refine(int x, int y, std::array<GeometrySample, kSubSamples>* samples) const {
    FineEmission emission;
    uint32_t traced = 0;
    for (const uint32_t count : kFineRays) {
      for (; traced < count; traced += PathTracer::kPacket) TraceEmission(x, y, traced, &emission);
      if (emission.most - emission.least <= kRefinedRange) break;
    }
    const float rays_of_cell = static_cast<float>(traced) / kSubSamples;
    for (size_t cell = 0; cell < kSubSamples; ++cell)
      (*samples)[cell].emitted = emission.sum[cell] / rays_of_cell;
  }

 private:
  /// Pixels from x0_ on; empty outside the frame.
  using Row = std::vector<Pixel>;

  /// Traces rays of one pixel in packets of their own, so the result is independent of other pixels.
  template <typename MakeRay>
  void TraceRays(std::span<GeometrySample> out, MakeRay make_ray) const {
    std::array<Ray, PathTracer::kPacket> rays;
    for (size_t first = 0; first < out.size(); first += rays.size()) {
      const size_t count = std::min(rays.size(), out.size() - first);
      for (size_t i = 0; i < count; ++i) rays[i] = make_ray(first + i);
      tracer_.TraceGeometry({rays.data(), count}, out.subspan(first, count));
    }
  }

  Ray RayOf(int x, int y, int sub_sample) const {
    const Vec2 lens = camera_.HasLens() ? LensPointOf(camera_.NumberOf(x, y), sub_sample) : Vec2{};
    const auto [right, down] = PlaceOfSubSample(sub_sample);
    return RayAt(x, y, {right, down}, lens, kGrid, static_cast<uint32_t>(sub_sample));
  }

  /// The ray of this number through a point in the pixel, one of a grid of `side` rays a side.
  Ray RayAt(int x, int y, Vec2 in_pixel, Vec2 lens, int side, uint32_t number) const {
    const Vec2 point = camera_.PointIn(x, y, in_pixel);
    Ray ray = camera_.RayThrough(point.x, point.y, lens, camera_.FilterWidth() / static_cast<float>(side));
    // The same key in all frames, so that half-transparent surfaces do not flicker.
    ray.random_key = Sampler(0, 0, camera_.NumberOf(x, y), number).Key(kCameraPair);
    return ray;
  }

  /// Adds a packet of fine rays, from number `first` on.
  void TraceEmission(int x, int y, uint32_t first, FineEmission* emission) const {
    constexpr int kSide = 16;  // of a square with as many points as the first fine rays
    std::array<GeometrySample, PathTracer::kPacket> fine;
    std::array<size_t, PathTracer::kPacket> cells;
    TraceRays(fine, [&](size_t i) {
      const uint32_t number = first + static_cast<uint32_t>(i);
      const Sampler sampler = SamplerOf(camera_.NumberOf(x, y), number);
      const Vec2 point = sampler.Get2D(kCameraPair);
      cells[i] = CellOf(point);
      return RayAt(x, y, point, sampler.Get2D(kLensPair), kSide, kSubSamples + number);
    });
    for (size_t i = 0; i < fine.size(); ++i) emission->Add(cells[i], fine[i].emitted);
  }

  Row ProbeRow(int y) const {
    Row row;
    if (y < frame_.y0 || y >= frame_.y1) return row;
    row.resize(static_cast<size_t>(x1_ - x0_));
    for (int x = x0_; x < x1_; ++x) {
      Pixel& pixel = row[static_cast<size_t>(x - x0_)];
      Trace(x, y, kFirst, pixel.samples);
      const Vec2 point = camera_.PointIn(x, y, {0.5f, 0.5f});
      const Ray centre = camera_.RayThrough(point.x, point.y, {0.5f, 0.5f});
      pixel.probe = ProbeOf(pixel.samples, centre);
      pixel.is_bright = std::any_of(pixel.samples.begin(), pixel.samples.end(), EmitsBrightly);
    }
    return row;
  }

  static bool EmitsBrightly(const GeometrySample& s) {
    return s.hit && Luminance(s.emitted.x, s.emitted.y, s.emitted.z) > kBrightLuminance;
  }

  using Rows = std::array<const Row*, 3>;  // above, here, below

  /// Whether test(pixel) holds for the pixel at x or one of its neighbours in the frame.
  template <typename Test>
  bool IsAnyNear(int x, const Rows& rows, Test test) const {
    for (const Row* row : rows) {
      if (row->empty()) continue;
      for (int near = std::max(x - 1, x0_); near < std::min(x + 2, x1_); ++near) {
        if (test((*row)[static_cast<size_t>(near - x0_)])) return true;
      }
    }
    return false;
  }

  Place PlaceOf(int x, const Pixel& pixel, const Rows& rows) const {
    const bool is_edge = pixel.probe.mixed || IsAnyNear(x, rows, [&pixel](const Pixel& other) {
                           return &other != &pixel && IsEdgeBetween(pixel.probe, other.probe);
                         });
    return {is_edge, is_edge && IsAnyNear(x, rows, [](const Pixel& other) { return other.is_bright; })};
  }

  const PathTracer& tracer_;
  const PictureCamera& camera_;
  const Rect frame_;
  const Rect rect_;
  const int x0_;  // the rows' first pixel and one past their last
  const int x1_;
};

/// All sub-samples of an edge pixel whose first ones are traced.
std::array<GeometrySample, kSubSamples> AllSamples(const PixelScan& scan, int x, int y,
                                                   const PixelScan::Pixel& pixel, bool is_near_light) {
  std::array<GeometrySample, kOthers.size()> others;
  scan.Trace(x, y, kOthers, others);
  std::array<GeometrySample, kSubSamples> samples;
  for (size_t i = 0; i < kFirst.size(); ++i) samples[static_cast<size_t>(kFirst[i])] = pixel.samples[i];
  for (size_t i = 0; i < kOthers.size(); ++i) samples[static_cast<size_t>(kOthers[i])] = others[i];
  if (is_near_light) scan.Refine(x, y, &samples);
  return samples;
}

}  // namespace

GeometryUnit RenderGeometryUnit(const PathTracer& tracer, const PictureCamera& camera, const Rect& frame,
                                const Rect& rect, const std::atomic<bool>* stop) {
  const PixelScan scan(tracer, camera, frame, rect);
  GeometryPicture picture(rect.width(), rect.height(), camera.HasLens());
  EdgeRows edges;
  EdgeMask mask(rect);
  scan.ForEachPixel(stop, [&](int x, int y, const PixelScan::Pixel& pixel, PixelScan::Place place) {
    mask.Set(x, y, place.is_edge);
    if (!place.is_edge) return picture.Store(x - rect.x0, y - rect.y0, pixel.samples, camera);
    const auto samples = AllSamples(scan, x, y, pixel, place.is_near_light);
    picture.Store(x - rect.x0, y - rect.y0, samples, camera);
    edges.Add(x, y, samples);
  });
  return {{picture.Take(), edges.Make()}, std::move(mask)};
}

EdgeMask FindEdgePixels(const PathTracer& tracer, const PictureCamera& camera, const Rect& frame,
                        const Rect& rect, const std::atomic<bool>* stop) {
  EdgeMask mask(rect);
  PixelScan(tracer, camera, frame, rect)
      .ForEachPixel(stop, [&mask](int x, int y, const PixelScan::Pixel&, PixelScan::Place place) {
        mask.Set(x, y, place.is_edge);
      });
  return mask;
}

}  // namespace lumifold::render
