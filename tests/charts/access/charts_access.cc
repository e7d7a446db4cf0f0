#include "tests/charts/access/charts_access.h"

#include <algorithm>
#include <vector>

#include "filter/image/layers.h"
#include "filter/image/portable_math.h"
#include "worker/render/tracing/pass_sums.h"
#include "worker/render/tracing/path_stream.h"
#include "worker/render/tracing/processor.h"

namespace lumifold::render {
namespace {

std::array<Vec2, kFirstSurfacePairs> FirstSurfaceNumbers(const Sampler& sampler) {
  std::array<Vec2, kFirstSurfacePairs> numbers;
  for (uint32_t pair = 0; pair < kFirstSurfacePairs; ++pair)
    numbers[pair] = sampler.Get2D(kCameraPair + 1 + pair);
  return numbers;
}

}  // namespace

void ChartsAccess::SetLightStrategy(LightStrategy strategy, Renderer* renderer) {
  renderer->tracer_.strategy_ = strategy;
}

void ChartsAccess::SetShading(Shading shading, Renderer* renderer) {
  renderer->tracer_.uses_lanes_ = shading == Shading::kInLanes;
}

void ChartsAccess::SetStreamPackets(size_t packets, Renderer* renderer) {
  renderer->stream_packets_ = packets;
}

void ChartsAccess::TraceSamples(const Rect& rect, int frame, SampleRange range,
                                absl::FunctionRef<void(const SampleRecord&)> visit) const {
  static_assert(kFirstSurfacePairs == PathSampler::kPairsPerSurface);
  const ScopedFloatEnvironment environment;
  std::array<LayerSample, PathTracer::kPacket> samples;
  std::array<GeometrySample, PathTracer::kPacket> geometry;
  for (int y = rect.y0; y < rect.y1; ++y) {
    for (int x = rect.x0; x < rect.x1; ++x) {
      const int64_t pixel = static_cast<int64_t>(y) * renderer_->settings_.width + x;
      ForEachCameraPacket(renderer_->camera_, renderer_->settings_.seed, frame, x, y, range,
                          [&](const CameraPacket& packet) {
                            tracer().Trace(packet.rays(), packet.samplers(), samples);
                            tracer().TraceGeometry(packet.rays(), geometry);
                            for (size_t i = 0; i < packet.size(); ++i) {
                              visit({pixel, packet.Index(i), packet.Point(i), packet.LensPoint(i),
                                     FirstSurfaceNumbers(packet.samplers()[i]), samples[i], geometry[i]});
                            }
                          });
    }
  }
}

LayeredImage ChartsAccess::RenderRadiance(const Rect& rect, int frame, SampleRange range,
                                          RenderCounts* counts) const {
  const ScopedFloatEnvironment environment;
  LayeredImage image(rect.width(), rect.height());
  const std::array<ColorView, 2> halves = {image.AddColor(layers::HalfA(layers::kNoisy)),
                                           image.AddColor(layers::HalfB(layers::kNoisy))};
  const std::array<FloatView, 2> samples = {image.Add(layers::kSamplesA), image.Add(layers::kSamplesB)};
  std::array<Vec3, PathTracer::kPacket> radiances;
  for (int y = rect.y0; y < rect.y1; ++y) {
    for (int x = rect.x0; x < rect.x1; ++x) {
      std::array<Vec3, 2> sums;
      std::array<float, 2> count = {0, 0};
      ForEachCameraPacket(renderer_->camera_, renderer_->settings_.seed, frame, x, y, range,
                          [&](const CameraPacket& packet) {
                            TraceRadiance(packet.rays(), packet.samplers(), radiances);
                            for (size_t i = 0; i < packet.size(); ++i) {
                              if (!counts->Add(IsFinite(radiances[i]))) continue;
                              sums[packet.Index(i) & 1] += radiances[i];
                              count[packet.Index(i) & 1] += 1;
                            }
                          });
      for (size_t half = 0; half < 2; ++half) {
        Put(halves[half], x - rect.x0, y - rect.y0, sums[half]);
        samples[half].At(x - rect.x0, y - rect.y0) = count[half];
      }
    }
  }
  return image;
}

Ray ChartsAccess::CentreRay(int x, int y, const Sampler& sampler) const {
  constexpr Vec2 kLensCentre = {0.5f, 0.5f};
  Ray ray = camera().RayThrough(static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f, kLensCentre);
  ray.random_key = sampler.Key(kCameraPair);
  return ray;
}

LayeredImage ChartsAccess::RenderGuide(const Rect& rect, int frame) const {
  const ScopedFloatEnvironment environment;
  LayeredImage image(rect.width(), rect.height());
  const ColorView direct = image.AddColor(layers::kDirect);
  const ColorView indirect = image.AddColor(layers::kIndirect);
  const std::vector<Sampler> samplers(PathTracer::kPacket, Sampler(renderer_->settings_.seed, frame, 0, 0));
  std::array<Ray, PathTracer::kPacket> rays;
  std::array<LayerSample, PathTracer::kPacket> samples;
  for (int y = rect.y0; y < rect.y1; ++y) {
    for (int first = rect.x0; first < rect.x1; first += static_cast<int>(PathTracer::kPacket)) {
      const size_t count = std::min(PathTracer::kPacket, static_cast<size_t>(rect.x1 - first));
      for (size_t i = 0; i < count; ++i) rays[i] = CentreRay(first + static_cast<int>(i), y, samplers[i]);
      tracer().Trace({rays.data(), count}, {samplers.data(), count}, samples);
      for (size_t i = 0; i < count; ++i) {
        if (!IsFinite(samples[i])) continue;
        const int x = first + static_cast<int>(i) - rect.x0;
        Put(direct, x, y - rect.y0, samples[i].direct);
        Put(indirect, x, y - rect.y0, samples[i].indirect);
      }
    }
  }
  return image;
}

void ChartsAccess::TraceRadiance(std::span<const Ray> rays, std::span<const Sampler> samplers,
                                 std::span<Vec3> out) const {
  std::array<LayerSample, PathTracer::kPacket> samples;
  TraceAs(rays, samplers, samples, [](Path& path) {
    path.options.levels = 0;
    path.options.is_single = true;
  });
  for (size_t i = 0; i < rays.size(); ++i) out[i] = samples[i].combined;
}

void ChartsAccess::TraceWithoutIndirect(std::span<const Ray> rays, std::span<const Sampler> samplers,
                                        std::span<LayerSample> out,
                                        std::span<std::optional<Surface>> diffuse) const {
  TraceAs(rays, samplers, out, [](Path& path) { path.options.is_direct_only = true; });
  for (size_t i = 0; i < rays.size(); ++i) {
    // Paths that were traced for their glossy light carry indirect light too.
    out[i].combined = out[i].combined - out[i].indirect * out[i].albedo;
    out[i].indirect = {};
    diffuse[i].reset();
    if (MaxComponent(out[i].albedo) > 0) diffuse[i] = FirstDiffuseSurface(rays[i]);
  }
}

void ChartsAccess::TraceAs(std::span<const Ray> rays, std::span<const Sampler> samplers,
                           std::span<LayerSample> out, absl::FunctionRef<void(Path&)> set) const {
  std::vector<Path> paths;
  for (size_t i = 0; i < rays.size(); ++i) {
    out[i].Clear();
    paths.emplace_back(rays[i], samplers[i], tracer().plan_.levels, &out[i]);
    set(paths.back());
  }
  PathStream stream(tracer());
  stream.Add(rays, paths);
  stream.Run();
}

std::optional<Surface> ChartsAccess::FirstDiffuseSurface(const Ray& ray) const {
  const Hit hit = tracer().embree_->Intersect(ray);
  if (hit.IsMiss()) return std::nullopt;
  const Surface surface = tracer().surfaces_.Read(hit, ray);
  if (!tracer().MakeBsdf(surface, -ray.direction).HasDiffuse()) return std::nullopt;
  return surface;
}

IndirectRadiance ChartsAccess::TraceIndirect(const Surface& surface, Vec3 direction,
                                             const Sampler& sampler) const {
  LayerSample unused;
  Path path({}, sampler, tracer().plan_.levels, &unused);
  BsdfSample step;
  step.wi = direction;
  step.pdf = Dot(direction, surface.normal) / kPi;
  path.Begin(PathPart::kLit, {1, 1, 1});
  path.Leave(surface, step);
  std::vector<Path> branches;
  for (bool goes_on = true; goes_on;) {
    Connection connection;
    Surface reached;
    const Hit hit = tracer().embree_->Intersect(path.ray);
    goes_on = tracer().Reach(hit, &path, &reached) &&
              tracer().Scatter(hit, reached, tracer().surfaces_.Shade(reached), path.random.Draw(path.vertex),
                               &path, &connection, &branches);
    if (connection.IsBlack()) continue;
    connection.light *= tracer().visibility_.Transmittance(connection.shadow_ray);
    path.Add(connection);
  }
  return {path.incident.indirect, path.incident.first_distance};
}

}  // namespace lumifold::render
