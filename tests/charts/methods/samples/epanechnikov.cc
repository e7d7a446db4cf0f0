#include "tests/charts/methods/samples/epanechnikov.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "filter/image/color.h"
#include "filter/image/planes.h"
#include "filter/kernels/box_mean.h"

namespace lumifold::charts {
namespace {

/// Rows that a task writes; it reads all samples whose kernel overlaps them.
constexpr int kStripRows = 16;

float LuminanceOf(scene::Vec3 color) { return Luminance(color.x, color.y, color.z); }

/// The mean luminance around each pixel.
Plane Pilot(const SampleSet& set, int radius, TaskPool* pool) {
  Planes mean = MakePlanes(1, set.width, set.height);
  ForEachPixel(set.width, set.height, [&](int x, int y) {
    for (uint32_t i = 0; i < set.samples_per_pixel; ++i)
      mean[0].At(x, y) += std::abs(LuminanceOf(set.At(x, y, i).radiance));
    mean[0].At(x, y) /= static_cast<float>(set.samples_per_pixel);
  });
  Plane everywhere = MakePlane(set.width, set.height, 1.0f);
  return std::move(filter::BoxMeans(mean, everywhere.view(), radius, pool)[0]);
}

/// The coordinate, mirrored into the picture.
int Mirrored(int i, int size) {
  const int period = 2 * size;
  const int within = ((i % period) + period) % period;
  return within < size ? within : period - 1 - within;
}

/// Rows [y0, y1) of the sum of all spread samples.
class Strip {
 public:
  Strip(int width, int height, int y0, int y1)
      : width_(width),
        height_(height),
        y0_(y0),
        y1_(y1),
        sums_(static_cast<size_t>(width) * static_cast<size_t>(y1 - y0)) {}

  /// Spreads `value` around pixel (x, y) by a kernel of `radius` pixels.
  void Spread(int x, int y, double radius, scene::Vec3 value) {
    const int reach = static_cast<int>(std::ceil(radius)) - 1;  // the kernel is 0 at its radius
    const double scale = 1.0 / (TotalWeight(radius, reach));
    for (int dy = -reach; dy <= reach; ++dy) {
      const int row = Mirrored(y + dy, height_);
      if (row < y0_ || row >= y1_) continue;
      for (int dx = -reach; dx <= reach; ++dx) {
        const double weight = Weight(dx, dy, radius) * scale;
        if (weight > 0) Add(Mirrored(x + dx, width_), row, value, weight);
      }
    }
  }

  void Write(double scale, Picture* picture) const {
    for (int y = y0_; y < y1_; ++y) {
      for (int x = 0; x < width_; ++x) {
        for (size_t c = 0; c < 3; ++c)
          (*picture)[c].At(x, y) = static_cast<float>(sums_[IndexOf(x, y)][c] * scale);
      }
    }
  }

 private:
  static double Weight(int dx, int dy, double radius) {
    return std::max(0.0, 1.0 - (dx * dx + dy * dy) / (radius * radius));
  }

  static double TotalWeight(double radius, int reach) {
    double total = 0;
    for (int dy = -reach; dy <= reach; ++dy) {
      for (int dx = -reach; dx <= reach; ++dx) total += Weight(dx, dy, radius);
    }
    return total;
  }

  size_t IndexOf(int x, int y) const {
    return static_cast<size_t>(y - y0_) * static_cast<size_t>(width_) + static_cast<size_t>(x);
  }

  void Add(int x, int y, scene::Vec3 value, double weight) {
    std::array<double, 3>& sum = sums_[IndexOf(x, y)];
    for (int c = 0; c < 3; ++c) sum[static_cast<size_t>(c)] += weight * static_cast<double>(value[c]);
  }

  int width_;
  int height_;
  int y0_;
  int y1_;
  std::vector<std::array<double, 3>> sums_;
};

/// The kernel's radius in pixels; at 1 and below a sample stays in its pixel.
double RadiusOf(scene::Vec3 radiance, float pilot, uint32_t samples, absl::Span<const float> values) {
  const double luminance = std::abs(static_cast<double>(LuminanceOf(radiance)));
  if (luminance == 0) return 1;  // and the pilot may be 0
  const double relative = luminance / (static_cast<double>(samples) * static_cast<double>(pilot));
  return std::clamp(static_cast<double>(values[0]) * std::sqrt(relative), 1.0,
                    static_cast<double>(values[1]));
}

absl::StatusOr<Picture> FilterProgressively(const SampleSet& set, absl::Span<const float> values,
                                            TaskPool* pool) {
  const Plane pilot = Pilot(set, static_cast<int>(values[2]), pool);
  const int reach = static_cast<int>(std::ceil(values[1]));
  Picture picture = MakePicture(set.width, set.height);
  ParallelFor(pool, (set.height + kStripRows - 1) / kStripRows, [&](int64_t number) {
    const int y0 = static_cast<int>(number) * kStripRows;
    const int y1 = std::min(y0 + kStripRows, set.height);
    Strip strip(set.width, set.height, y0, y1);
    for (int y = std::max(0, y0 - reach); y < std::min(set.height, y1 + reach); ++y) {
      for (int x = 0; x < set.width; ++x) {
        for (uint32_t i = 0; i < set.samples_per_pixel; ++i) {
          const scene::Vec3 radiance = set.At(x, y, i).radiance;
          strip.Spread(x, y, RadiusOf(radiance, pilot.At(x, y), set.samples_per_pixel, values), radiance);
        }
      }
    }
    strip.Write(1.0 / set.samples_per_pixel, &picture);
  });
  return picture;
}

}  // namespace

SampleMethod EpanechnikovMethod() {
  return {
      .info =
          {.name = "epanechnikov",
           .summary = "each sample spread by a parabolic kernel, wider for brighter outliers",
           .source = "Suykens & Willems 2000, reconstructed",
           .parameters =
               {{"scale",
                 "radius in pixels of a sample of average brightness, times sqrt(spp)",
                 2,
                 {1, 2, 4, 8},
                 0.01f,
                 100},
                {"most", "largest radius in pixels", 16, {16}, 1, 64},
                {"pilot", "radius of the windows that estimate the picture's luminance", 1, {0, 1}, 0, 32}},
           .uses_auxiliary = false},
      .filter = FilterProgressively};
}

}  // namespace lumifold::charts
