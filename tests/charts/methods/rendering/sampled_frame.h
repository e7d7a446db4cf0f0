#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "absl/types/span.h"
#include "filter/image/planes.h"
#include "tests/charts/methods/rendering/camera_frame.h"

namespace lumifold::charts {

/// Accumulates samples of a frame's pixels, with a different count for each pixel. Samples of even index form
/// half A, the others half B.
class SampledFrame {
 public:
  /// Keeps a pointer to the frame.
  explicit SampledFrame(const CameraFrame& frame);

  /// Takes `more[p]` more samples of each pixel p, in row-major order. Samples that are not finite are
  /// skipped.
  void Take(absl::Span<const uint32_t> more, TaskPool* pool);
  /// Takes the initial samples of an adaptive method, uniformly: a quarter of `samples_per_pixel`, but at
  /// least 4 if the budget allows.
  void TakeFirst(uint32_t samples_per_pixel, TaskPool* pool);

  int width() const { return frame_->width(); }
  int height() const { return frame_->height(); }
  uint64_t taken() const { return taken_; }

  /// The mean R G B of the samples; 0 without samples.
  Planes Means() const;
  /// The mean of half A (0) or B (1); of all samples if the half has none.
  Planes HalfMeans(size_t half) const;
  /// The variance of Means(), from the sample variance of each pixel; for fewer than two samples, from the
  /// variance of means in 3x3 pixels.
  Planes Variances() const;
  /// The variance of HalfMeans(), from the variance of all samples.
  Planes HalfVariances(size_t half) const;
  /// Samples of each pixel, at least 1.
  Plane Counts() const;
  /// The fraction of each pixel's samples in half A; 0.5 without samples.
  Plane ShareOfHalfA() const;

 private:
  struct Pixel {
    uint32_t next = 0;  // index of the sample to take next
    std::array<float, 2> count = {0, 0};
    std::array<std::array<double, 3>, 2> sum{};
    std::array<double, 3> squares{};
  };

  const Pixel& At(int x, int y) const {
    return pixels_[static_cast<size_t>(y) * static_cast<size_t>(width()) + static_cast<size_t>(x)];
  }
  void Trace(int x, int y, uint32_t more, Pixel* pixel) const;
  double NeighbourVariance(const Planes& means, size_t channel, int x, int y) const;

  const CameraFrame* frame_;
  std::vector<Pixel> pixels_;
  uint64_t taken_ = 0;
};

/// The `count` pixels of largest `worth`, unordered; of equals those of lowest number.
std::vector<size_t> WorthiestPixels(const Plane& worth, size_t count);

}  // namespace lumifold::charts
