#include "tests/charts/methods/samples/probabilistic.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "filter/image/planes.h"
#include "filter/image/portable_math.h"
#include "filter/layers/features.h"

namespace lumifold::charts {
namespace {

using scene::Vec3;

/// Light by path length, as far as layers separate it: direct, indirect, and light seen in mirrors and
/// through glass.
enum Cluster : size_t { kDirect, kIndirect, kRest, kClusters };

struct ClusterSums {
  float count = 0;  // samples that carry light
  Vec3 light;
};

struct PixelSums {
  std::array<ClusterSums, kClusters> clusters;
  float valid = 0;  // samples that hit a surface with a diffuse lobe
  Vec3 albedo;
  Vec3 unfiltered;  // light of no cluster: what surfaces radiate, and what means of products have over
                    // products
  std::array<float, filter::kGeometryFeatures> geometry;
};

bool IsBlack(Vec3 color) { return color == Vec3{}; }

/// The sample's light in no layer; 0 if it is only rounding.
Vec3 RestOf(const ChartSample& s) {
  constexpr float kRounding = 1e-4f;
  const Vec3 light = (s.direct + s.indirect) * s.albedo + s.emitted;
  const Vec3 rest = s.radiance - light;
  const float size = std::sqrt(Dot(rest, rest));
  return size > kRounding * std::sqrt(Dot(light, light)) ? rest : Vec3{};
}

/// Sums the samples of one pixel: light per cluster; albedo and unfiltered light as means over all samples.
PixelSums SumPixel(const SampleSet& set, int x, int y) {
  PixelSums sums;
  Vec3 normal;
  Vec3 radiance;
  float distance = 0;
  float hits = 0;
  const auto add = [&](Cluster cluster, Vec3 light) {
    if (!IsBlack(light)) sums.clusters[cluster].count += 1;
    sums.clusters[cluster].light += light;
  };
  for (uint32_t i = 0; i < set.samples_per_pixel; ++i) {
    const ChartSample& s = set.At(x, y, i);
    if (!IsBlack(s.albedo)) sums.valid += 1;
    add(kDirect, s.direct);
    add(kIndirect, s.indirect);
    add(kRest, RestOf(s));
    sums.albedo += s.albedo;
    radiance += s.radiance;
    normal += s.normal;
    distance += s.distance;
    if (s.distance > 0) hits += 1;
  }
  const float share = 1.0f / static_cast<float>(set.samples_per_pixel);
  sums.albedo *= share;
  const Vec3 diffuse = sums.clusters[kDirect].light + sums.clusters[kIndirect].light;
  const Vec3 lit = sums.valid > 0 ? diffuse * sums.albedo * (1.0f / sums.valid) : Vec3{};
  sums.unfiltered = (radiance - sums.clusters[kRest].light) * share - lit;
  if (hits > 0) {
    const float length = Length(normal);
    const Vec3 n = length > 0 ? normal / length : Vec3{};
    sums.geometry = filter::GeometryFeature({n.x, n.y, n.z}, distance / hits, {});
  }
  return sums;
}

/// Logarithms of 0!, 1!, ..., n!.
std::vector<double> LogFactorials(uint32_t n) {
  std::vector<double> logs = {0.0};
  for (uint32_t i = 1; i <= n; ++i)
    logs.push_back(logs.back() + static_cast<double>(Log(static_cast<float>(i))));
  return logs;
}

class Filter {
 public:
  Filter(const SampleSet& set, absl::Span<const float> values)
      : set_(set),
        radius_(static_cast<int>(values[0])),
        strictness_(values[1]),
        log_factorials_(LogFactorials(set.samples_per_pixel)),
        pixels_(static_cast<size_t>(set.width) * static_cast<size_t>(set.height)) {}

  void SumRow(int y) {
    for (int x = 0; x < set_.width; ++x) pixels_[IndexOf(x, y)] = SumPixel(set_, x, y);
  }

  Vec3 At(int x, int y) const {
    const PixelSums& p = pixels_[IndexOf(x, y)];
    std::array<WeightedLight, kClusters> weighted;
    for (int qy = std::max(0, y - radius_); qy <= std::min(set_.height - 1, y + radius_); ++qy) {
      for (int qx = std::max(0, x - radius_); qx <= std::min(set_.width - 1, x + radius_); ++qx)
        AddNeighbour(p, pixels_[IndexOf(qx, qy)], (qx - x) * (qx - x) + (qy - y) * (qy - y), &weighted);
    }
    const Vec3 diffuse = weighted[kDirect].Mean() + weighted[kIndirect].Mean();
    return diffuse * p.albedo + weighted[kRest].Mean() + p.unfiltered;
  }

 private:
  struct WeightedLight {
    Vec3 light;
    float samples = 0;

    Vec3 Mean() const { return samples > 0 ? light / samples : Vec3{}; }
  };

  size_t IndexOf(int x, int y) const {
    return static_cast<size_t>(y) * static_cast<size_t>(set_.width) + static_cast<size_t>(x);
  }

  /// The number of samples that a cluster's light is averaged over.
  float SamplesOf(const PixelSums& sums, size_t cluster) const {
    return cluster == kRest ? static_cast<float>(set_.samples_per_pixel) : sums.valid;
  }

  void AddNeighbour(const PixelSums& p, const PixelSums& q, int square,
                    std::array<WeightedLight, kClusters>* out) const {
    float exponent = static_cast<float>(square) / (0.5f * static_cast<float>(radius_ * radius_));
    for (size_t k = 0; k < p.geometry.size(); ++k)
      exponent += 0.5f * (p.geometry[k] - q.geometry[k]) * (p.geometry[k] - q.geometry[k]);
    for (size_t c = 0; c < kClusters; ++c) {
      const float n_p = SamplesOf(p, c);
      const float n_q = SamplesOf(q, c);
      if (n_p == 0 || n_q == 0) continue;
      const double disagreement =
          std::max(NegativeLogLikelihood(p.clusters[c].count, n_p, q.clusters[c].count, n_q),
                   NegativeLogLikelihood(q.clusters[c].count, n_q, p.clusters[c].count, n_p));
      const float w = Exp(-exponent - strictness_ * static_cast<float>(disagreement));
      (*out)[c].light += w * q.clusters[c].light;
      (*out)[c].samples += w * n_q;
    }
  }

  /// Negative log-likelihood ratio, by Poisson's distribution, of `found` of `n` samples against the most
  /// likely number, given the rate `expected` of `n_expected`.
  double NegativeLogLikelihood(float expected, float n_expected, float found, float n) const {
    const float mean = std::max(0.5f, expected * n / n_expected);
    const float mode = std::floor(mean);
    const auto log_factorial = [&](float i) { return log_factorials_[static_cast<size_t>(i)]; };
    return static_cast<double>(mode - found) * static_cast<double>(Log(mean)) + log_factorial(found) -
           log_factorial(mode);
  }

  const SampleSet& set_;
  int radius_;
  float strictness_;
  std::vector<double> log_factorials_;
  std::vector<PixelSums> pixels_;
};

absl::StatusOr<Picture> FilterByCounts(const SampleSet& set, absl::Span<const float> values, TaskPool* pool) {
  Filter filter(set, values);
  ParallelFor(pool, set.height, [&](int64_t y) { filter.SumRow(static_cast<int>(y)); });
  Picture picture = MakePicture(set.width, set.height);
  ParallelFor(pool, set.height, [&](int64_t row) {
    const int y = static_cast<int>(row);
    for (int x = 0; x < set.width; ++x) {
      const Vec3 color = filter.At(x, y);
      for (int c = 0; c < 3; ++c) picture[static_cast<size_t>(c)].At(x, y) = color[c];
    }
  });
  return picture;
}

}  // namespace

SampleMethod ProbabilisticMethod() {
  return {
      .info = {.name = "probabilistic",
               .summary = "means over pixels whose samples carry light equally often, by path length",
               .source = "Doidge & Jones 2013, reconstructed",
               .parameters =
                   {{"radius", "of the windows, in pixels", 7, {3, 7, 12}, 1, 64},
                    {"strictness", "exponent of the likelihood of the counts", 1, {0.25f, 1, 4}, 0, 100}}},
      .filter = FilterByCounts};
}

}  // namespace lumifold::charts
