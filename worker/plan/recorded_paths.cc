#include "worker/plan/recorded_paths.h"

#include <array>
#include <cmath>
#include <numeric>

#include "filter/image/color.h"
#include "worker/render/camera_packet.h"
#include "worker/render/floating_point.h"

namespace lumifold::plan {
namespace {

using render::PathVertex;
using render::Vec3;

double Product(Vec3 a, Vec3 b) { return static_cast<double>(scene::Dot(a, b)); }

/// Of one path, whose last vertex is its end.
PathCosts CostsOf(std::span<const PathVertex> vertices, const render::Roulette& rule) {
  const Vec3 all = vertices.back().gathered;
  PathCosts costs;
  double reached = 1;  // the probability that the path gets to the vertex
  Vec3 before;
  int64_t rays_before = 0;
  for (size_t i = 0; i < vertices.size(); ++i) {
    const PathVertex& vertex = vertices[i];
    // What comes here counts 1 / reached times if the path gets here, and so does what came before.
    const Vec3 here = vertex.gathered - before;
    const Vec3 later = all - vertex.gathered;
    costs.second_moment += (Product(here, here) + 2 * Product(here, later)) / reached;
    costs.rays += reached * static_cast<double>(vertex.rays - rays_before);
    before = vertex.gathered;
    rays_before = vertex.rays;
    const auto weighted = static_cast<float>(static_cast<double>(vertex.throughput) / reached);
    reached *= static_cast<double>(rule.Survival(static_cast<int>(i) + 1, weighted));
    if (reached <= 0) break;
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

void RecordedPaths::Add(std::span<const PathVertex> vertices, double weight) {
  if (vertices.empty() || !std::isfinite(scene::MaxComponent(vertices.back().gathered))) return;
  vertices_.insert(vertices_.end(), vertices.begin(), vertices.end());
  weights_.push_back(weight);
  ends_.push_back(vertices_.size());
}

PathCosts RecordedPaths::CostsWith(const render::Roulette& rule) const {
  PathCosts sum;
  size_t begin = 0;
  for (size_t path = 0; path < ends_.size(); ++path) {
    const PathCosts costs = CostsOf(std::span(vertices_).subspan(begin, ends_[path] - begin), rule);
    sum.second_moment += weights_[path] * costs.second_moment;
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
      const double weight = 1 / SquaredLight(light[pixel], mean);
      const auto record = [&](const render::CameraPacket& packet) {
        for (size_t i = 0; i < packet.size(); ++i) {
          tracer.RecordIndirect(packet.rays()[i], packet.samplers()[i], &vertices);
          paths.Add(vertices, weight);
        }
      };
      render::ForEachCameraPacket(camera, picture.seed, /*frame=*/0, x, y, {0, kProbeSamples}, record);
    }
  }
  return paths;
}

}  // namespace lumifold::plan
