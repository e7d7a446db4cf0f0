#include "worker/plan/recorded_paths.h"

#include <array>
#include <cmath>
#include <numeric>

#include "filter/image/color.h"
#include "worker/render/geometry/camera_packet.h"
#include "worker/render/tracing/processor.h"

namespace lumifold::plan {
namespace {

using render::PathVertex;
using render::Vec3;

/// The squared radiance over the pixel's light. Beyond `outlier` it grows as the radiance itself.
double NoiseOf(Vec3 radiance, const PixelLight& pixel) {
  double noise = 0;
  for (const float channel : {radiance.x, radiance.y, radiance.z}) {
    const double x = std::abs(double{channel});
    noise += x <= pixel.outlier ? x * x : pixel.outlier * (2 * x - pixel.outlier);
  }
  return noise / pixel.light;
}

/// Of one path, whose last vertex is its end.
PathCosts CostsOf(std::span<const PathVertex> vertices, const PixelLight& pixel,
                  const render::Roulette& rule) {
  PathCosts costs;
  double reached = 1;  // the probability that the path gets to the vertex
  Vec3 gathered;       // if it does
  PathVertex before;
  for (size_t i = 0; i < vertices.size() && reached > 0; ++i) {
    const PathVertex& vertex = vertices[i];
    gathered += (vertex.gathered - before.gathered) * static_cast<float>(1 / reached);
    costs.rays += reached * static_cast<double>(vertex.rays - before.rays);
    const auto throughput = static_cast<float>(static_cast<double>(vertex.throughput) / reached);
    const bool is_end = i + 1 == vertices.size();
    const double survival =
        is_end ? 0.0 : static_cast<double>(rule.Survival(static_cast<int>(i) + 1, throughput));
    costs.noise += reached * (1 - survival) * NoiseOf(gathered, pixel);
    reached *= survival;
    before = vertex;
  }
  return costs;
}

/// The mean luminance of each pixel, row-major.
std::vector<double> LightOfPixels(const render::PathTracer& tracer, const render::PictureCamera& camera,
                                  const render::RenderSettings& picture) {
  std::vector<double> light;
  std::array<render::LayerSample, render::PathTracer::kPacket> samples;
  for (int y = 0; y < picture.height; ++y) {
    for (int x = 0; x < picture.width; ++x) {
      double sum = 0;
      const auto trace = [&](const render::CameraPacket& packet) {
        tracer.Trace(packet.rays(), packet.samplers(), samples);
        for (size_t i = 0; i < packet.size(); ++i) {
          const Vec3 c = samples[i].combined;
          if (render::IsFinite(samples[i])) sum += static_cast<double>(Luminance(c.x, c.y, c.z));
        }
      };
      render::ForEachCameraPacket(camera, picture.seed, /*frame=*/0, x, y, {0, kProbeSamples}, trace);
      light.push_back(sum / kProbeSamples);
    }
  }
  return light;
}

}  // namespace

void RecordedPaths::Add(std::span<const PathVertex> vertices, const PixelLight& pixel) {
  if (vertices.empty()) return;
  const Vec3 all = vertices.back().gathered;
  if (!std::isfinite(all.x) || !std::isfinite(all.y) || !std::isfinite(all.z)) return;
  vertices_.insert(vertices_.end(), vertices.begin(), vertices.end());
  pixels_.push_back(pixel);
  ends_.push_back(vertices_.size());
}

PathCosts RecordedPaths::CostsWith(const render::Roulette& rule) const {
  PathCosts sum;
  size_t begin = 0;
  for (size_t path = 0; path < ends_.size(); ++path) {
    const PathCosts costs =
        CostsOf(std::span(vertices_).subspan(begin, ends_[path] - begin), pixels_[path], rule);
    sum.noise += costs.noise;
    sum.rays += costs.rays;
    begin = ends_[path];
  }
  return sum;
}

RecordedPaths RecordPaths(const render::PathTracer& tracer, const render::PictureCamera& camera,
                          const render::RenderSettings& picture, int64_t* samples) {
  const render::ScopedFloatEnvironment environment;
  const int64_t count = int64_t{picture.width} * picture.height * int64_t{kProbeSamples};
  const std::vector<double> light = LightOfPixels(tracer, camera, picture);
  const double mean = std::accumulate(light.begin(), light.end(), 0.0) / static_cast<double>(light.size());
  *samples += count;
  RecordedPaths paths;
  if (!(mean > 0)) return paths;
  *samples += count;
  std::vector<PathVertex> vertices;
  for (int y = 0; y < picture.height; ++y) {
    for (int x = 0; x < picture.width; ++x) {
      const size_t pixel =
          static_cast<size_t>(y) * static_cast<size_t>(picture.width) + static_cast<size_t>(x);
      const double shown = std::sqrt(SquaredLight(light[pixel], mean));
      const auto record = [&](const render::CameraPacket& packet) {
        for (size_t i = 0; i < packet.size(); ++i) {
          tracer.RecordIndirect(packet.rays()[i], packet.samplers()[i], &vertices);
          paths.Add(vertices, {.light = shown, .outlier = shown * kProbeSamples});
        }
      };
      render::ForEachCameraPacket(camera, picture.seed, /*frame=*/0, x, y, {0, kProbeSamples}, record);
    }
  }
  return paths;
}

}  // namespace lumifold::plan
