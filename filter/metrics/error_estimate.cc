#include "filter/metrics/error_estimate.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "filter/image/check.h"
#include "filter/image/layers.h"
#include "filter/image/portable_math.h"

namespace lumifold::metrics {
namespace {

/// Weight of a squared difference at a value: the squared slope of the metric's curve.
float WeightAt(float value, ErrorMetric metric) {
  if (metric == ErrorMetric::kRelMse) return 1.0f / (value * value + 0.01f);  // as RelMse
  constexpr float kLinearEnd = 0.0031308f;                                    // of the sRGB curve
  if (!(value < 1.0f)) return 0.0f;                                           // clamped there
  const float slope = 255.0f * (value < kLinearEnd ? 12.92f : 1.055f / 2.4f * Pow(value, 1.0f / 2.4f - 1.0f));
  return slope * slope;
}

/// Sums over the pixels of a block that have samples of both halves.
struct Sums {
  double variance = 0;  // of the picture
  double noise = 0;     // variance of the film
  double samples = 0;
  int64_t pixels = 0;
  /// Of the picture, by channel: weights, weighted values and their squares.
  std::array<double, 3> weights = {};
  std::array<double, 3> values = {};
  std::array<double, 3> squares = {};

  /// How much the picture varies from pixel to pixel.
  double Detail() const {
    double sum = 0;
    for (size_t c = 0; c < 3; ++c) {
      if (weights[c] > 0) sum += std::max(0.0, squares[c] - values[c] * values[c] / weights[c]);
    }
    return sum;
  }
};

class Pixels {
 public:
  Pixels(const FilteredFilm& filtered, ErrorMetric metric)
      : picture_(filtered.picture),
        deviation_(filtered.deviation),
        half_a_(filtered.film.GetColor(layers::HalfA(layers::kNoisy))),
        half_b_(filtered.film.GetColor(layers::HalfB(layers::kNoisy))),
        samples_a_(filtered.film.Get(layers::kSamplesA)),
        samples_b_(filtered.film.Get(layers::kSamplesB)),
        metric_(metric) {}

  void Add(int x, int y, Sums* sums) const {
    const double in_a = samples_a_.At(x, y);
    const double in_b = samples_b_.At(x, y);
    if (!(in_a > 0 && in_b > 0)) return;
    const double samples = in_a + in_b;
    ++sums->pixels;
    sums->samples += samples;
    for (size_t c = 0; c < 3; ++c) {
      const double weight = WeightAt(picture_[c].At(x, y), metric_);
      const double value = picture_[c].At(x, y);
      sums->weights[c] += weight;
      sums->values[c] += weight * value;
      sums->squares[c] += weight * value * value;
      const double deviation = deviation_[c].At(x, y);
      sums->variance += weight * deviation * deviation;
      const double halves = double{half_a_[c].At(x, y)} - double{half_b_[c].At(x, y)};
      sums->noise += weight * in_a * in_b / (samples * samples) * halves * halves;
    }
  }

 private:
  ConstColorView picture_;
  ConstColorView deviation_;
  ConstColorView half_a_, half_b_;
  ConstFloatView samples_a_, samples_b_;
  ErrorMetric metric_;
};

/// Logarithms of what one sample would leave of a block's variance and of its noise, and of its detail.
struct Point {
  Sums* block = nullptr;
  double noise = 0;
  double detail = 0;
  double variance = 0;
};

std::vector<Point> PointsOf(std::vector<Sums>* blocks) {
  std::vector<Point> points;
  for (Sums& block : *blocks) {
    const auto noise = static_cast<float>(block.noise);
    const auto variance = static_cast<float>(block.variance);
    const auto detail = static_cast<float>(block.Detail());
    if (!(noise > 0) || !(variance > 0) || !(detail > 0)) continue;
    const float samples = Log(static_cast<float>(block.samples / static_cast<double>(block.pixels)));
    points.push_back({&block, double{Log(noise) + samples}, double{Log(detail)},
                      double{Log(variance) + kErrorDecline * samples}});
  }
  return points;
}

/// A plane through points by least squares, and the variance around it.
class Trend {
 public:
  explicit Trend(const std::vector<Point>& points) {
    const auto count = static_cast<double>(points.size());
    for (const Point& point : points) {
      noise_ += point.noise / count;
      detail_ += point.detail / count;
      variance_ += point.variance / count;
    }
    FitSlopes(points);
    for (const Point& point : points) {
      const double off = point.variance - At(point);
      around_ += off * off / count;
    }
  }

  double At(const Point& point) const {
    return variance_ + by_noise_ * (point.noise - noise_) + by_detail_ * (point.detail - detail_);
  }
  double around() const { return around_; }

 private:
  void FitSlopes(const std::vector<Point>& points) {
    double nn = 0;
    double nd = 0;
    double dd = 0;
    double nv = 0;
    double dv = 0;
    for (const Point& point : points) {
      const double n = point.noise - noise_;
      const double d = point.detail - detail_;
      const double v = point.variance - variance_;
      nn += n * n;
      nd += n * d;
      dd += d * d;
      nv += n * v;
      dv += d * v;
    }
    const double determinant = nn * dd - nd * nd;
    constexpr double kLeastDeterminant = 1e-6;  // of the product: below, detail tells what noise tells
    if (determinant > kLeastDeterminant * nn * dd) {
      by_noise_ = (nv * dd - dv * nd) / determinant;
      by_detail_ = (dv * nn - nv * nd) / determinant;
    } else {
      by_noise_ = nn > 0 ? nv / nn : 0;
    }
  }

  double noise_ = 0;  // means
  double detail_ = 0;
  double variance_ = 0;
  double by_noise_ = 0;  // slopes
  double by_detail_ = 0;
  double around_ = 0;
};

/// Draws the variance of each block towards that of others of its noise and detail; their sum stays.
void DrawTogether(std::vector<Sums>* blocks) {
  constexpr size_t kLeastPoints = 16;  // for slopes that are worth something
  const std::vector<Point> points = PointsOf(blocks);
  if (points.size() < kLeastPoints) return;
  const Trend trend(points);
  if (!(trend.around() > 0)) return;
  const double share = std::min(1.0, kLogVarianceOfBlock / trend.around());
  double before = 0;
  double after = 0;
  for (const Point& point : points) {
    before += point.block->variance;
    const double change = share * (trend.At(point) - point.variance);
    point.block->variance *= double{Exp(static_cast<float>(change))};
    after += point.block->variance;
  }
  for (const Point& point : points) point.block->variance *= before / after;
}

}  // namespace

ErrorEstimate EstimateError(const FilteredFilm& filtered, int block, ErrorMetric metric, TaskPool* pool) {
  const int width = filtered.film.width();
  const int height = filtered.film.height();
  LUMIFOLD_CHECK(block >= 1 && filtered.picture[0].width() == width &&
                 filtered.deviation[0].width() == width);
  const Pixels pixels(filtered, metric);
  ErrorEstimate estimate;
  estimate.columns = (width + block - 1) / block;
  estimate.rows = (height + block - 1) / block;
  const auto columns = static_cast<size_t>(estimate.columns);
  std::vector<Sums> sums(columns * static_cast<size_t>(estimate.rows));
  ParallelFor(pool, estimate.rows, [&](int64_t row) {
    const int y0 = static_cast<int>(row) * block;
    for (int y = y0; y < std::min(y0 + block, height); ++y) {
      for (int x = 0; x < width; ++x)
        pixels.Add(x, y, &sums[static_cast<size_t>(row) * columns + static_cast<size_t>(x / block)]);
    }
  });
  DrawTogether(&sums);
  for (const Sums& of_block : sums) {
    const double values = 3.0 * static_cast<double>(of_block.pixels);
    estimate.blocks.push_back(of_block.pixels == 0 ? -1.0 : kErrorOverVariance * of_block.variance / values);
  }
  return estimate;
}

}  // namespace lumifold::metrics
