#include "tests/charts/methods/samples/statistical.h"

#include <algorithm>
#include <array>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <limits>
#include <vector>

#include "filter/image/planes.h"
#include "filter/image/portable_math.h"

namespace lumifold::charts {
namespace {

using scene::Vec3;

constexpr double kLevel = 0.005;  // of the two-sided test

/// y = (x^e - 1) / e at e = 1/2; light below 0 counts as none.
double BoxCox(float light) { return 2 * (std::sqrt(static_cast<double>(std::max(light, 0.0f))) - 1); }

/// What the test compares of one channel of a pixel.
struct Statistic {
  double mean = 0;    // of the transformed samples, corrected for their skewness
  double spread = 0;  // variance of the mean times the square of the test's quantile

  bool IsLike(const Statistic& other) const {
    const double difference = mean - other.mean;
    return difference * difference <= spread + other.spread;
  }
};

Statistic StatisticOf(const SampleSet& set, int x, int y, int channel, double quantile) {
  const double n = set.samples_per_pixel;
  double sum = 0;
  for (uint32_t i = 0; i < set.samples_per_pixel; ++i) sum += BoxCox(set.At(x, y, i).radiance[channel]);
  const double mean = sum / n;
  double squares = 0, cubes = 0;
  for (uint32_t i = 0; i < set.samples_per_pixel; ++i) {
    const double difference = BoxCox(set.At(x, y, i).radiance[channel]) - mean;
    squares += difference * difference;
    cubes += difference * difference * difference;
  }
  const double variance = squares / (n - 1);
  const double skew = variance > std::numeric_limits<float>::epsilon() ? cubes / (6 * variance * n * n) : 0;
  return {mean + skew, quantile * quantile * variance / n};
}

struct Pixel {
  Vec3 light, albedo, normal;
  std::array<Statistic, 3> channels;

  bool IsLike(const Pixel& other) const {
    for (size_t c = 0; c < channels.size(); ++c) {
      if (!channels[c].IsLike(other.channels[c])) return false;
    }
    return true;
  }
};

class Filter {
 public:
  Filter(const SampleSet& set, absl::Span<const float> values)
      : set_(set),
        radius_(static_cast<int>(values[0])),
        place_(ScaleOf(values[1])),
        albedo_(ScaleOf(values[2])),
        normal_(ScaleOf(values[3])),
        pixels_(static_cast<size_t>(set.width) * static_cast<size_t>(set.height)) {
    const boost::math::students_t distribution(2.0 * set.samples_per_pixel - 2);
    quantile_ = quantile(complement(distribution, kLevel / 2));
  }

  void PrepareRow(int y) {
    for (int x = 0; x < set_.width; ++x) {
      Pixel& pixel = pixels_[IndexOf(x, y)];
      for (uint32_t i = 0; i < set_.samples_per_pixel; ++i) {
        const ChartSample& sample = set_.At(x, y, i);
        pixel.light += sample.radiance;
        pixel.albedo += sample.albedo;
        pixel.normal += sample.normal;
      }
      const float share = 1.0f / static_cast<float>(set_.samples_per_pixel);
      for (Vec3* sum : {&pixel.light, &pixel.albedo, &pixel.normal}) *sum *= share;
      for (int c = 0; c < 3; ++c)
        pixel.channels[static_cast<size_t>(c)] = StatisticOf(set_, x, y, c, quantile_);
    }
  }

  Vec3 At(int x, int y) const {
    const Pixel& centre = pixels_[IndexOf(x, y)];
    Vec3 sum = centre.light;
    float total = 1;
    for (int qy = std::max(0, y - radius_); qy <= std::min(set_.height - 1, y + radius_); ++qy) {
      for (int qx = std::max(0, x - radius_); qx <= std::min(set_.width - 1, x + radius_); ++qx) {
        const int distance2 = (qx - x) * (qx - x) + (qy - y) * (qy - y);
        const Pixel& other = pixels_[IndexOf(qx, qy)];
        if (distance2 == 0 || distance2 > radius_ * radius_ || !centre.IsLike(other)) continue;
        const float weight = Exp(place_ * static_cast<float>(distance2) +
                                 albedo_ * LengthSquared(centre.albedo - other.albedo) +
                                 normal_ * LengthSquared(centre.normal - other.normal));
        sum += other.light * weight;
        total += weight;
      }
    }
    return sum / total;
  }

 private:
  /// The factor of a squared difference in the exponent of a Gaussian.
  static float ScaleOf(float deviation) { return -0.5f / (deviation * deviation); }

  size_t IndexOf(int x, int y) const {
    return static_cast<size_t>(y) * static_cast<size_t>(set_.width) + static_cast<size_t>(x);
  }

  const SampleSet& set_;
  int radius_;
  float place_, albedo_, normal_;
  double quantile_;
  std::vector<Pixel> pixels_;
};

absl::StatusOr<Picture> FilterByTests(const SampleSet& set, absl::Span<const float> values, TaskPool* pool) {
  Picture picture = MakePicture(set.width, set.height);
  const auto put = [&](int x, int y, Vec3 color) {
    for (size_t c = 0; c < 3; ++c) picture[c].At(x, y) = color[static_cast<int>(c)];
  };
  if (set.samples_per_pixel < 2) {
    ForEachPixel(set.width, set.height, [&](int x, int y) { put(x, y, set.At(x, y, 0).radiance); });
    return picture;
  }
  Filter filter(set, values);
  ParallelFor(pool, set.height, [&](int64_t y) { filter.PrepareRow(static_cast<int>(y)); });
  ParallelFor(pool, set.height, [&](int64_t y) {
    for (int x = 0; x < set.width; ++x) put(x, static_cast<int>(y), filter.At(x, static_cast<int>(y)));
  });
  return picture;
}

}  // namespace

SampleMethod StatisticalMethod() {
  return {.info = {.name = "statistical",
                   .summary = "pixels that a t-test of their samples does not tell apart",
                   .source = "Sakai et al. 2024",
                   .parameters = {{"radius", "of the window, in pixels", 20, {20}, 1, 64},
                                  {"place", "range of places in pixels", 10, {5, 10}, 0.1f, 100},
                                  {"albedo", "range of albedo", 0.02f, {0.02f, 0.1f}, 1e-3f, 10},
                                  {"normal", "range of normals", 0.1f, {0.1f, 0.3f}, 1e-3f, 10}},
                   .uses_auxiliary = true},
          .filter = FilterByTests};
}

}  // namespace lumifold::charts
