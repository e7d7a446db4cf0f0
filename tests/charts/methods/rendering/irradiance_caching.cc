#include "tests/charts/methods/rendering/irradiance_caching.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "filter/image/color.h"
#include "filter/image/mix_bits.h"
#include "tests/charts/methods/rendering/camera_frame.h"
#include "tests/charts/methods/rendering/irradiance.h"
#include "tests/charts/methods/rendering/irradiance_cache.h"
#include "tests/charts/methods/rendering/irradiance_picture.h"

namespace lumifold::charts {
namespace {

using render::Ray;
using render::RenderSettings;
using render::ScopedFloatEnvironment;
using render::Surface;
using scene::Vec3;

/// Pixels between candidates of the first grid.
constexpr int kCoarsestGrid = 32;

/// Candidates gathered in parallel. The result depends on it, so it is not the number of threads.
constexpr size_t kBatch = 64;

/// Bounds in pixels on the distance at which a record is used.
constexpr float kLeastReach = 3;
constexpr float kMostReach = 20;

/// The picture is interpolated with a larger tolerance than the cache is filled with, which smooths the
/// borders.
constexpr float kPictureTolerance = 2;

float Brightness(Vec3 color) { return Luminance(color.x, color.y, color.z); }

/// A record of `irradiance` with its radius; `footprint` is the width of a pixel there.
IrradianceRecord MakeRecord(const Surface& surface, const Irradiance& irradiance, float footprint,
                            float accuracy) {
  IrradianceRecord record = {surface.position, surface.normal, irradiance};
  const ColorGradient& by_step = irradiance.by_step;
  const Vec3 steepness = {Brightness({by_step[0].x, by_step[1].x, by_step[2].x}),
                          Brightness({by_step[0].y, by_step[1].y, by_step[2].y}),
                          Brightness({by_step[0].z, by_step[1].z, by_step[2].z})};
  const float gradient = Length(steepness);
  const float brightness = Brightness(irradiance.value);
  float radius = irradiance.mean_distance;
  if (gradient * radius > brightness) radius = brightness / gradient;
  record.least_radius = kLeastReach * footprint / accuracy;
  record.radius = std::clamp(radius, record.least_radius, kMostReach * footprint / accuracy);
  if (radius < record.least_radius) {
    for (Vec3& channel : record.irradiance.by_step) channel *= radius / record.least_radius;
  }
  return record;
}

/// Fills a cache for one frame.
class CacheFiller {
 public:
  CacheFiller(const CameraFrame& frame, const HemisphereStrata& strata, float accuracy, TaskPool* pool,
              IrradianceCache* cache)
      : frame_(frame), strata_(strata), accuracy_(accuracy), pool_(pool), cache_(cache) {}

  /// Result: the number of paths traced.
  uint64_t Fill() {
    for (int spacing = kCoarsestGrid; spacing >= 1; spacing /= 2) {
      const std::vector<int64_t> pixels = Grid(spacing);
      for (size_t first = 0; first < pixels.size(); first += kBatch) {
        const size_t count = std::min(kBatch, pixels.size() - first);
        AddBatch({pixels.data() + first, count});
      }
    }
    return paths_;
  }

 private:
  /// The pixels of a grid that are not in a coarser one, in scattered order, so that neighbours are seldom in
  /// one batch.
  std::vector<int64_t> Grid(int spacing) const {
    std::vector<std::pair<uint64_t, int64_t>> scattered;
    for (int y = 0; y < frame_.height(); y += spacing) {
      for (int x = 0; x < frame_.width(); x += spacing) {
        const int coarser = 2 * spacing;
        if (spacing < kCoarsestGrid && x % coarser == 0 && y % coarser == 0) continue;
        const int64_t pixel = static_cast<int64_t>(y) * frame_.width() + x;
        scattered.emplace_back(MixBits(static_cast<uint64_t>(pixel)), pixel);
      }
    }
    std::sort(scattered.begin(), scattered.end());
    std::vector<int64_t> pixels;
    pixels.reserve(scattered.size());
    for (const auto& [place, pixel] : scattered) pixels.push_back(pixel);
    return pixels;
  }

  void AddBatch(absl::Span<const int64_t> pixels) {
    std::vector<std::optional<IrradianceRecord>> found(pixels.size());
    CameraFrame::ForEach(pool_, static_cast<int64_t>(pixels.size()), [&](int64_t i) {
      found[static_cast<size_t>(i)] = Gather(pixels[static_cast<size_t>(i)]);
    });
    const ScopedFloatEnvironment environment;
    for (const std::optional<IrradianceRecord>& record : found) {
      if (!record.has_value()) continue;
      paths_ += static_cast<uint64_t>(strata_.count());
      if (!cache_->Look(record->position, record->normal, 1).has_value()) cache_->Insert(*record);
    }
  }

  /// Nothing if no diffuse surface is seen, or the cache already covers the point.
  std::optional<IrradianceRecord> Gather(int64_t pixel) const {
    const Ray ray =
        frame_.CentreRay(static_cast<int>(pixel % frame_.width()), static_cast<int>(pixel / frame_.width()));
    const std::optional<Surface> surface = frame_.tracer().FirstDiffuseSurface(ray);
    if (!surface.has_value() || cache_->Look(surface->position, surface->normal, 1).has_value())
      return std::nullopt;
    const float footprint = CameraFrame::Footprint(ray, *surface);
    return MakeRecord(*surface, GatherIrradiance(frame_.tracer(), *surface, strata_, frame_.seed(), pixel),
                      footprint, accuracy_);
  }

  const CameraFrame& frame_;
  HemisphereStrata strata_;
  float accuracy_;
  TaskPool* pool_;
  IrradianceCache* cache_;
  uint64_t paths_ = 0;
};

absl::StatusOr<RenderedPicture> Render(std::shared_ptr<const scene::Scene> scene,
                                       const RenderSettings& settings, uint32_t samples_per_pixel,
                                       absl::Span<const float> values, TaskPool* pool) {
  const scene::Bounds bounds = WorldBounds(*scene);
  const absl::StatusOr<CameraFrame> frame = CameraFrame::Create(std::move(scene), settings);
  if (!frame.ok()) return frame.status();
  const float accuracy = values[0];
  IrradianceCache cache(bounds, accuracy);
  RenderedPicture out;
  out.gather_paths =
      CacheFiller(*frame, HemisphereStrata::OfRings(static_cast<int>(values[1])), accuracy, pool, &cache)
          .Fill();
  out.records = cache.size();
  const auto look = [&](const Surface& surface, int, int) {
    return cache.Look(surface.position, surface.normal, kPictureTolerance);
  };
  RenderWithIrradiance(*frame, samples_per_pixel, look, pool, &out);
  return out;
}

}  // namespace

RenderMethod IrradianceCachingMethod() {
  return {
      .info = {.name = "irradiance-cache",
               .summary = "indirect light gathered at few points and interpolated by its gradients",
               .source = "Ward et al. 1988; Ward & Heckbert 1992; neighbour clamping of Krivanek et al. 2006",
               .parameters = {{"accuracy",
                               "fraction of its radius up to which a record is used",
                               0.15f,
                               {0.1f, 0.15f, 0.3f},
                               0.02f,
                               1},
                              {"rings",
                               "rings of hemisphere strata, with pi times as many sectors each",
                               14,
                               {10, 14, 28},
                               1,
                               128}}},
      .render = Render};
}

}  // namespace lumifold::charts
