#include "tests/charts/methods/rendering/irradiance_filtering.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "filter/image/planes.h"
#include "tests/charts/methods/rendering/camera_frame.h"
#include "tests/charts/methods/rendering/irradiance.h"
#include "tests/charts/methods/rendering/irradiance_picture.h"

namespace lumifold::charts {
namespace {

using render::Ray;
using render::RenderSettings;
using render::Surface;
using scene::Vec3;

/// The largest radius of the mean, in pixels.
constexpr int kMostPixels = 40;

/// The surface at a pixel's centre.
struct Place {
  bool is_diffuse = false;
  Vec3 position;
  Vec3 normal;
  Vec3 irradiance;
  float distance = 0;   // harmonic mean distance of the visible surfaces
  float footprint = 0;  // width of a pixel, in metres
};

float ByTurn(Vec3 a, Vec3 b) {
  const float cosine = std::max(0.0f, Dot(a, b));
  const float squared = cosine * cosine;
  return squared * squared * squared * squared;
}

/// The irradiance of one frame's pixels.
class IrradianceMap {
 public:
  IrradianceMap(const CameraFrame& frame, int rays, TaskPool* pool)
      : frame_(frame), places_(static_cast<size_t>(frame.pixels())) {
    const HemisphereStrata strata = HemisphereStrata::OfRays(rays);
    frame.ForEachPixel(pool, [&](int x, int y) { places_[Number(x, y)] = Gather(x, y, strata); });
    for (const Place& place : places_) paths_ += place.is_diffuse ? static_cast<uint64_t>(strata.count()) : 0;
  }

  uint64_t paths() const { return paths_; }

  /// Each pixel becomes the mean of its neighbours within `reach` times its harmonic mean distance.
  void Filter(float reach, TaskPool* pool) {
    std::vector<Vec3> means(places_.size());
    frame_.ForEachPixel(pool, [&](int x, int y) {
      if (places_[Number(x, y)].is_diffuse) means[Number(x, y)] = MeanAround(x, y, reach);
    });
    for (size_t i = 0; i < places_.size(); ++i) places_[i].irradiance = means[i];
  }

  /// Interpolates between the pixels next to the sample.
  std::optional<Vec3> Look(const Surface& surface, int x, int y) const {
    Vec3 sum;
    float weights = 0;
    ForEachNear(x, y, 1, [&](const Place& place) {
      const float distance = Length(surface.position - place.position);
      if (distance > place.distance) return;
      // Distances below a tenth of a pixel hardly change the weight.
      const float pixels = distance / place.footprint + 0.1f;
      const float weight = ByTurn(surface.normal, place.normal) / (pixels * pixels);
      sum += place.irradiance * weight;
      weights += weight;
    });
    constexpr float kLeastWeight = 1e-6f;
    if (weights < kLeastWeight) return std::nullopt;
    return sum / weights;
  }

 private:
  size_t Number(int x, int y) const {
    return static_cast<size_t>(y) * static_cast<size_t>(frame_.width()) + static_cast<size_t>(x);
  }

  template <typename Visit>
  void ForEachNear(int x, int y, int radius, Visit visit) const {
    for (int v = std::max(0, y - radius); v <= std::min(frame_.height() - 1, y + radius); ++v) {
      for (int u = std::max(0, x - radius); u <= std::min(frame_.width() - 1, x + radius); ++u) {
        if (const Place& place = places_[Number(u, v)]; place.is_diffuse) visit(place);
      }
    }
  }

  Place Gather(int x, int y, const HemisphereStrata& strata) const {
    const Ray ray = frame_.CentreRay(x, y);
    const std::optional<Surface> surface = frame_.tracer().FirstDiffuseSurface(ray);
    if (!surface.has_value()) return {};
    const Irradiance found = GatherIrradiance(frame_.tracer(), *surface, strata, frame_.seed(),
                                              static_cast<int64_t>(Number(x, y)));
    return {.is_diffuse = true,
            .position = surface->position,
            .normal = surface->normal,
            .irradiance = found.value,
            .distance = found.mean_distance,
            .footprint = CameraFrame::Footprint(ray, *surface)};
  }

  Vec3 MeanAround(int x, int y, float reach) const {
    const Place& here = places_[Number(x, y)];
    // Few paths may miss a near surface: the minimum over adjacent pixels is safer.
    float distance = here.distance;
    ForEachNear(x, y, 1, [&](const Place& place) { distance = std::min(distance, place.distance); });
    const float radius = std::min(reach * distance, static_cast<float>(kMostPixels) * here.footprint);
    Vec3 sum = here.irradiance;
    float weights = 1;
    ForEachNear(x, y, static_cast<int>(std::ceil(radius / here.footprint)), [&](const Place& place) {
      const float away = Length(place.position - here.position);
      if (away >= radius || &place == &here) return;
      const float weight = (1 - away / radius) * ByTurn(here.normal, place.normal);
      sum += place.irradiance * weight;
      weights += weight;
    });
    return sum / weights;
  }

  const CameraFrame& frame_;
  std::vector<Place> places_;
  uint64_t paths_ = 0;
};

absl::StatusOr<RenderedPicture> Render(std::shared_ptr<const scene::Scene> scene,
                                       const RenderSettings& settings, uint32_t samples_per_pixel,
                                       absl::Span<const float> values, TaskPool* pool) {
  const absl::StatusOr<CameraFrame> frame = CameraFrame::Create(std::move(scene), settings);
  if (!frame.ok()) return frame.status();
  IrradianceMap map(*frame, static_cast<int>(values[0]), pool);
  map.Filter(values[1], pool);
  RenderedPicture out;
  out.gather_paths = map.paths();
  out.records = static_cast<uint64_t>(frame->pixels());
  RenderWithIrradiance(
      *frame, samples_per_pixel,
      [&](const Surface& surface, int x, int y) { return map.Look(surface, x, y); }, pool, &out);
  return out;
}

}  // namespace

RenderMethod IrradianceFilteringMethod() {
  return {.info = {.name = "irradiance-filtering",
                   .summary = "indirect light gathered in every pixel and averaged over neighbours in space",
                   .source = "Kontkanen et al. 2004, reconstructed",
                   .parameters =
                       {{"rays", "approximate number of gathered paths per pixel", 32, {16, 32, 64}, 1, 4096},
                        {"reach",
                         "radius of the mean, over the mean distance of visible surfaces",
                         0.3f,
                         {0.15f, 0.3f, 0.6f},
                         0,
                         10}}},
          .render = Render};
}

}  // namespace lumifold::charts
