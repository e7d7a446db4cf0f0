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

/// A film's noisy layer.
struct Noisy {
  explicit Noisy(const LayeredImage& film)
      : mean(film.GetColor(layers::kNoisy)),
        half_a(film.GetColor(layers::HalfA(layers::kNoisy))),
        half_b(film.GetColor(layers::HalfB(layers::kNoisy))),
        samples_a(film.Get(layers::kSamplesA)),
        samples_b(film.Get(layers::kSamplesB)) {}

  ConstColorView mean, half_a, half_b;
  ConstFloatView samples_a, samples_b;
};

/// Sums over the pixels of a block.
struct Sums {
  double variance = 0;    // of the later picture
  double noise = 0;       // variance of the later film, by its halves
  double samples = 0;     // of the later film
  double earlier = 0;     // of the earlier one, where the error was measured too
  double error = 0;       // of the earlier one, by the new samples
  int64_t with_news = 0;  // pixels that have new samples
  /// Of the later picture, by channel: weights, weighted values and their squares.
  std::array<double, 3> weights = {};
  std::array<double, 3> values = {};
  std::array<double, 3> squares = {};

  /// How much the later picture varies from pixel to pixel.
  double Detail() const {
    double sum = 0;
    for (size_t c = 0; c < 3; ++c) {
      if (weights[c] > 0) sum += std::max(0.0, squares[c] - values[c] * values[c] / weights[c]);
    }
    return sum;
  }
};

/// Mean of the samples that the later film has over the earlier one.
double MeanOfNew(double later, double later_count, double earlier, double earlier_count) {
  return (later * later_count - earlier * earlier_count) / (later_count - earlier_count);
}

class Comparison {
 public:
  Comparison(const FilteredFilm& earlier, const FilteredFilm& later, ErrorMetric metric)
      : before_(earlier.film),
        after_(later.film),
        earlier_(earlier.picture),
        later_(later.picture),
        metric_(metric) {}

  void Add(int x, int y, Sums* sums) const {
    const double a0 = before_.samples_a.At(x, y);
    const double b0 = before_.samples_b.At(x, y);
    const double a1 = after_.samples_a.At(x, y);
    const double b1 = after_.samples_b.At(x, y);
    const double m = a0 + b0;
    const double n = a1 + b1;
    if (m < 1 || n <= m) return;
    ++sums->with_news;
    sums->samples += n;
    const double share_now = a1 / n;
    const double fall = Pow(static_cast<float>(n / m), kErrorDecline);  // of the error, from m to n
    const bool has_halves = a1 > a0 && b1 > b0;
    for (size_t c = 0; c < 3; ++c) {
      const double weight = WeightAt(later_[c].At(x, y), metric_);
      const double value = later_[c].At(x, y);
      sums->weights[c] += weight;
      sums->values[c] += weight * value;
      sums->squares[c] += weight * value * value;
      const double step = value - double{earlier_[c].At(x, y)};
      sums->variance += weight * step * step / (fall - 1);
      const double halves = double{after_.half_a[c].At(x, y)} - double{after_.half_b[c].At(x, y)};
      sums->noise += weight * share_now * (1 - share_now) * halves * halves;
      if (!has_halves) continue;
      const double half_a = MeanOfNew(after_.half_a[c].At(x, y), a1, before_.half_a[c].At(x, y), a0);
      const double half_b = MeanOfNew(after_.half_b[c].At(x, y), b1, before_.half_b[c].At(x, y), b0);
      const double share = (a1 - a0) / (n - m);
      const double mean = share * half_a + (1 - share) * half_b;
      const double off = double{earlier_[c].At(x, y)} - mean;
      const double noise = share * (1 - share) * (half_a - half_b) * (half_a - half_b);
      sums->error += weight * (off * off - noise);
      sums->earlier += weight * step * step * fall / (fall - 1);
    }
  }

 private:
  Noisy before_;
  Noisy after_;
  ConstColorView earlier_;
  ConstColorView later_;
  ErrorMetric metric_;
};

/// The error over the variance, drawn towards the usual one by its standard error over the blocks (James and Stein).
double BiasFactor(const std::vector<Sums>& blocks) {
  double error = 0;
  double variance = 0;
  int64_t count = 0;
  for (const Sums& block : blocks) {
    error += block.error;
    variance += block.earlier;
    count += block.earlier > 0 ? 1 : 0;
  }
  if (count < 2 || !(variance > 0)) return kUsualBiasFactor;
  const double ratio = std::max(1.0, error / variance);  // no error is less than its variance
  double squares = 0;
  for (const Sums& block : blocks) {
    const double residual = block.error - ratio * block.earlier;
    squares += residual * residual;
  }
  const double off = ratio - kUsualBiasFactor;
  if (off == 0) return ratio;
  const double share = 1 - squares / (variance * variance) / (off * off);
  return kUsualBiasFactor + off * std::max(0.0, share);
}

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
    const float samples = Log(static_cast<float>(block.samples / static_cast<double>(block.with_news)));
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

ErrorEstimate EstimateError(const FilteredFilm& earlier, const FilteredFilm& later, int block,
                            ErrorMetric metric, TaskPool* pool) {
  const int width = later.film.width();
  const int height = later.film.height();
  LUMIFOLD_CHECK(block >= 1 && earlier.film.width() == width && earlier.film.height() == height);
  const Comparison comparison(earlier, later, metric);
  ErrorEstimate estimate;
  estimate.columns = (width + block - 1) / block;
  estimate.rows = (height + block - 1) / block;
  const auto columns = static_cast<size_t>(estimate.columns);
  std::vector<Sums> sums(columns * static_cast<size_t>(estimate.rows));
  ParallelFor(pool, estimate.rows, [&](int64_t row) {
    const int y0 = static_cast<int>(row) * block;
    for (int y = y0; y < std::min(y0 + block, height); ++y) {
      for (int x = 0; x < width; ++x)
        comparison.Add(x, y, &sums[static_cast<size_t>(row) * columns + static_cast<size_t>(x / block)]);
    }
  });
  estimate.bias_factor = BiasFactor(sums);
  DrawTogether(&sums);
  for (const Sums& of_block : sums) {
    const double channels = 3.0 * static_cast<double>(of_block.with_news);
    estimate.blocks.push_back(of_block.with_news == 0 ? -1.0
                                                      : estimate.bias_factor * of_block.variance / channels);
  }
  return estimate;
}

}  // namespace lumifold::metrics
