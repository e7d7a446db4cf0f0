#include "worker/render/geometry_unit.h"

#include <algorithm>
#include <array>
#include <span>
#include <utility>
#include <vector>

#include "filter/image/layers.h"
#include "worker/render/edge_set.h"
#include "worker/render/pass_sums.h"

namespace lumifold::render {
namespace {

/// Sub-samples lie at the centres of a 4x4 grid.
constexpr int kGrid = 4;
static_assert(kGrid * kGrid == kSubSamples);

/// The sub-samples that are traced first: one in each row, column and quadrant of the grid. The same holds
/// for their lens points.
constexpr std::array<int, 4> kFirst = {0, 7, 9, 14};
/// The other sub-samples, which are traced in edge pixels.
constexpr std::array<int, 12> kOthers = {1, 2, 3, 4, 5, 6, 8, 10, 11, 12, 13, 15};
static_assert(kFirst.size() + kOthers.size() == kSubSamples);

/// Where the ray of a sub-sample passes the lens: each centre of another 4x4 grid once, so that every row and
/// every column of sub-samples covers every row and every column of the lens grid (two orthogonal Latin
/// squares, from sums and products in the field of four elements).
Vec2 LensPointOf(int sub_sample) {
  constexpr int kTwice[kGrid] = {0, 2, 3, 1};
  const int x = sub_sample % kGrid;
  const int y = sub_sample / kGrid;
  const int column = x ^ y;
  const int row = x ^ kTwice[y];
  return {(static_cast<float>(column) + 0.5f) / kGrid, (static_cast<float>(row) + 0.5f) / kGrid};
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
  GeometryPicture(int width, int height)
      : image_(width, height), levels_(width, height, layers::LevelFeatureChannels) {
    for (size_t i = 0; i < layers::kLevelFeatures.size(); ++i)
      surface_[i] = image_.Add(layers::kLevelFeatures[i]);
    planar_depth_ = image_.Add(layers::kPlanarDepth);
    roughness_ = image_.Add(layers::kRoughness);
    alpha_ = image_.Add(layers::kAlpha);
  }

  void Store(int x, int y, std::span<const GeometrySample> samples, const PictureCamera& camera) {
    const auto count = static_cast<float>(samples.size());
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
  LayeredImage image_;
  LevelImages levels_;
  std::array<FloatView, layers::kLevelFeatures.size()> surface_;
  FloatView planar_depth_;
  FloatView roughness_;
  FloatView alpha_;
};

/// Traces the unit row by row. Keeps the first samples of three rows, which the edge test compares.
class GeometryUnit {
 public:
  GeometryUnit(const PathTracer& tracer, const PictureCamera& camera, const Rect& frame, const Rect& rect)
      : tracer_(tracer),
        camera_(camera),
        frame_(frame),
        rect_(rect),
        x0_(std::max(rect.x0 - 1, frame.x0)),
        x1_(std::min(rect.x1 + 1, frame.x1)),
        picture_(rect.width(), rect.height()) {}

  EdgedImage Render(const std::atomic<bool>* stop) {
    Row above = ProbeRow(rect_.y0 - 1);
    Row here = ProbeRow(rect_.y0);
    for (int y = rect_.y0; y < rect_.y1; ++y) {
      if (stop != nullptr && stop->load(std::memory_order_relaxed)) break;
      Row below = ProbeRow(y + 1);
      for (int x = rect_.x0; x < rect_.x1; ++x) {
        const Pixel& pixel = here[static_cast<size_t>(x - x0_)];
        if (IsEdge(x, pixel.probe, {&above, &here, &below})) {
          StoreEdge(x, y, pixel);
        } else {
          picture_.Store(x - rect_.x0, y - rect_.y0, pixel.samples, camera_);
        }
      }
      above = std::move(here);
      here = std::move(below);
    }
    return {picture_.Take(), edges_.Make()};
  }

 private:
  struct Pixel {
    std::array<GeometrySample, kFirst.size()> samples;
    EdgeProbe probe;
  };
  /// Pixels from x0_ on; empty outside the frame.
  using Row = std::vector<Pixel>;

  Ray RayOf(int x, int y, int sub_sample) const {
    const int column = sub_sample % kGrid;
    const int row = sub_sample / kGrid;
    const float dx = (static_cast<float>(column) + 0.5f) / kGrid;
    const float dy = (static_cast<float>(row) + 0.5f) / kGrid;
    const Vec2 point = camera_.PointIn(x, y, {dx, dy});
    Ray ray = camera_.RayThrough(point.x, point.y, LensPointOf(sub_sample), camera_.FilterWidth() / kGrid);
    // The same key in all frames, so that half-transparent surfaces do not flicker.
    ray.random_key =
        Sampler(0, 0, camera_.NumberOf(x, y), static_cast<uint32_t>(sub_sample)).Key(kCameraPair);
    return ray;
  }

  /// Traces some of a pixel's sub-samples, in packets of their own, so the result is independent of other
  /// pixels.
  void Trace(int x, int y, std::span<const int> sub_samples, std::span<GeometrySample> out) const {
    std::array<Ray, PathTracer::kPacket> rays;
    for (size_t first = 0; first < sub_samples.size(); first += rays.size()) {
      const size_t count = std::min(rays.size(), sub_samples.size() - first);
      for (size_t i = 0; i < count; ++i) rays[i] = RayOf(x, y, sub_samples[first + i]);
      tracer_.TraceGeometry({rays.data(), count}, out.subspan(first, count));
    }
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
    }
    return row;
  }

  bool IsEdge(int x, const EdgeProbe& probe, const std::array<const Row*, 3>& rows) const {
    if (probe.mixed) return true;
    for (const Row* row : rows) {
      if (row->empty()) continue;
      for (int near = std::max(x - 1, x0_); near < std::min(x + 2, x1_); ++near) {
        const EdgeProbe& other = (*row)[static_cast<size_t>(near - x0_)].probe;
        if (&other != &probe && IsEdgeBetween(probe, other)) return true;
      }
    }
    return false;
  }

  void StoreEdge(int x, int y, const Pixel& pixel) {
    std::array<GeometrySample, kOthers.size()> others;
    Trace(x, y, kOthers, others);
    std::array<GeometrySample, kSubSamples> samples;
    for (size_t i = 0; i < kFirst.size(); ++i) samples[static_cast<size_t>(kFirst[i])] = pixel.samples[i];
    for (size_t i = 0; i < kOthers.size(); ++i) samples[static_cast<size_t>(kOthers[i])] = others[i];
    picture_.Store(x - rect_.x0, y - rect_.y0, samples, camera_);
    edges_.Add(x, y, samples);
  }

  const PathTracer& tracer_;
  const PictureCamera& camera_;
  const Rect frame_;
  const Rect rect_;
  const int x0_;  // the rows' first pixel and one past their last
  const int x1_;
  GeometryPicture picture_;
  EdgeRows edges_;
};

}  // namespace

EdgedImage RenderGeometryUnit(const PathTracer& tracer, const PictureCamera& camera, const Rect& frame,
                              const Rect& rect, const std::atomic<bool>* stop) {
  return GeometryUnit(tracer, camera, frame, rect).Render(stop);
}

}  // namespace lumifold::render
