#include "filter/metrics/error_estimate.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "filter/image/check.h"
#include "filter/image/color.h"
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

/// Squared error of a value that is off by `deviation` to either side. The display's curve is not straight
/// over large ones, and ends: an unlucky pixel beside a lamp would outweigh the rest of the picture by the
/// curve's slope.
double SquaredError(float value, float deviation, ErrorMetric metric) {
  if (metric == ErrorMetric::kRelMse) return double{WeightAt(value, metric)} * deviation * deviation;
  const double shown = double{SrgbFromLinear(value)};
  const double above = double{SrgbFromLinear(value + deviation)} - shown;
  const double below = double{SrgbFromLinear(value - deviation)} - shown;
  return 255.0 * 255.0 * 0.5 * (above * above + below * below);
}

/// Sums over the pixels of a block that have samples of both halves.
struct Sums {
  double error = 0;  // squared, of the picture, as its deviation shows it
  double all = 0;    // the same with that of returned energy
  double noise = 0;  // variance of the film
  double samples = 0;
  int64_t pixels = 0;
  int64_t edge_pixels = 0;   // of all pixels
  int64_t unmet_pixels = 0;  // whose samples are all alike, though the filter changed them
  /// Of the picture, by channel: weights, weighted values and their squares.
  std::array<double, 3> weights = {};
  std::array<double, 3> values = {};
  std::array<double, 3> squares = {};

  double MeanSamples() const { return samples / static_cast<double>(pixels); }
  /// How much the picture varies from pixel to pixel; mean over them.
  double Detail() const {
    double sum = 0;
    for (size_t c = 0; c < 3; ++c) {
      if (weights[c] > 0) sum += std::max(0.0, squares[c] - values[c] * values[c] / weights[c]);
    }
    return sum / static_cast<double>(pixels);
  }
};

class Pixels {
 public:
  Pixels(const FilteredFilm& filtered, ErrorMetric metric)
      : picture_(ViewOf(filtered.filtered.picture)),
        deviation_(ViewOf(filtered.filtered.deviation)),
        returned_(ViewOf(filtered.filtered.returned)),
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
    bool has_noise = false;
    bool is_changed = false;
    for (size_t c = 0; c < 3; ++c) {
      const double weight = WeightAt(picture_[c].At(x, y), metric_);
      const double value = picture_[c].At(x, y);
      sums->weights[c] += weight;
      sums->values[c] += weight * value;
      sums->squares[c] += weight * value * value;
      const float deviation = deviation_[c].At(x, y);
      const float returned = returned_[c].width() > 0 ? returned_[c].At(x, y) : 0.0f;
      sums->error += SquaredError(picture_[c].At(x, y), deviation, metric_);
      sums->all += SquaredError(picture_[c].At(x, y), deviation + returned, metric_);
      const double halves = double{half_a_[c].At(x, y)} - double{half_b_[c].At(x, y)};
      has_noise |= halves != 0;
      is_changed |= picture_[c].At(x, y) != half_a_[c].At(x, y);
      sums->noise += weight * in_a * in_b / (samples * samples) * halves * halves;
    }
    sums->unmet_pixels += !has_noise && is_changed ? 1 : 0;
  }

 private:
  ConstColorView picture_;
  ConstColorView deviation_, returned_;
  ConstColorView half_a_, half_b_;
  ConstFloatView samples_a_, samples_b_;
  ErrorMetric metric_;
};

/// The blocks of a picture, row by row.
struct Blocks {
  int columns = 0;
  int rows = 0;
  int edge = 0;  // of a block, in pixels
  std::vector<Sums> sums = {};

  Sums& At(int column, int row) {
    return sums[static_cast<size_t>(row) * static_cast<size_t>(columns) + static_cast<size_t>(column)];
  }
};

Blocks SumUp(const FilteredFilm& filtered, int edge, ErrorMetric metric, TaskPool* pool) {
  const int width = filtered.film.width();
  const int height = filtered.film.height();
  Blocks blocks = {(width + edge - 1) / edge, (height + edge - 1) / edge, edge};
  blocks.sums.resize(static_cast<size_t>(blocks.columns) * static_cast<size_t>(blocks.rows));
  const Pixels pixels(filtered, metric);
  ParallelFor(pool, blocks.rows, [&](int64_t row) {
    const int y0 = static_cast<int>(row) * edge;
    for (int y = y0; y < std::min(y0 + edge, height); ++y) {
      for (int x = 0; x < width; ++x) pixels.Add(x, y, &blocks.At(x / edge, static_cast<int>(row)));
    }
  });
  const LayeredImage* edges = filtered.edges;
  for (int row = 0; edges != nullptr && row < edges->height(); ++row) {
    const int x = static_cast<int>(edges->Get(layers::kPixelX).At(0, row));
    const int y = static_cast<int>(edges->Get(layers::kPixelY).At(0, row));
    if (x >= 0 && x < width && y >= 0 && y < height) ++blocks.At(x / edge, y / edge).edge_pixels;
  }
  return blocks;
}

/// From what the deviation shows of each block to errors whose sum is that of the picture.
void ScaleToError(Blocks* blocks) {
  double shown = 0;
  double all = 0;
  double noise = 0;
  for (const Sums& block : blocks->sums) {
    shown += block.error;
    all += block.all;
    noise += block.noise;
  }
  if (!(shown > 0)) return;
  const double left = noise > 0 ? std::min(1.0, shown / noise) : 1.0;
  const double over_variance = 1.0 + (kErrorOverVariance - 1.0) * (1.0 - left);
  for (Sums& block : blocks->sums) block.error *= over_variance * all / shown;
}

/// What tells how large the error of a block is: logarithms of the noise of one sample around it, of its
/// detail, and of the parts of edge pixels in it and around it.
constexpr Eigen::Index kTraits = 4;
using Traits = Eigen::Vector<double, kTraits>;

struct Point {
  Sums* block = nullptr;
  Traits traits = {};
  double error = 0;  // logarithm of what one sample would leave
};

/// Half the width of a block's surroundings, in pixels: the reach of most of the filter's windows.
constexpr int kAround = 8;
/// Added to parts of edge pixels, whose logarithms are taken: that of six pixels in the surroundings.
constexpr double kLeastEdges = 0.02;

double LogOf(double value) { return double{Log(static_cast<float>(value))}; }

/// The error with one sample over that with so many.
double DeclineOver(double samples) { return double{Pow(static_cast<float>(samples), kErrorDecline)}; }

/// Of blocks [column +- kAround pixels] x [row +- kAround pixels].
Sums SumAround(const Blocks& blocks, int column, int row) {
  const int reach = std::max(1, kAround / blocks.edge);
  Sums around;
  for (int r = std::max(0, row - reach); r <= std::min(blocks.rows - 1, row + reach); ++r) {
    const auto first = static_cast<size_t>(r) * static_cast<size_t>(blocks.columns);
    for (int c = std::max(0, column - reach); c <= std::min(blocks.columns - 1, column + reach); ++c) {
      const Sums& block = blocks.sums[first + static_cast<size_t>(c)];
      if (block.pixels == 0) continue;
      around.noise += block.noise * block.MeanSamples();
      around.error += block.error * DeclineOver(block.MeanSamples());
      around.pixels += block.pixels;
      around.edge_pixels += block.edge_pixels;
    }
  }
  return around;
}

/// Where all samples of a pixel are alike, and the filter changed it by what is around, they may not have met
/// what others have: it is taken to err as what is around. The sum of all errors stays.
void FillUnmet(Blocks* blocks, TaskPool* pool) {
  std::vector<double> errors(blocks->sums.size());
  ParallelFor(pool, blocks->rows, [&](int64_t row) {
    for (int column = 0; column < blocks->columns; ++column) {
      const Sums& block = blocks->At(column, static_cast<int>(row));
      double& error = errors[static_cast<size_t>(&block - blocks->sums.data())];
      error = block.error;
      if (block.unmet_pixels == 0) continue;
      const Sums around = SumAround(*blocks, column, static_cast<int>(row));
      error += around.error / DeclineOver(block.MeanSamples()) * static_cast<double>(block.unmet_pixels) /
               static_cast<double>(around.pixels);
    }
  });
  double before = 0;
  double after = 0;
  for (size_t i = 0; i < errors.size(); ++i) {
    before += blocks->sums[i].error;
    after += errors[i];
  }
  if (!(after > before)) return;
  for (size_t i = 0; i < errors.size(); ++i) blocks->sums[i].error = errors[i] * (before / after);
}

/// Without a block where a trait is unknown.
std::vector<Point> PointsOf(Blocks* blocks, TaskPool* pool) {
  std::vector<Point> all(blocks->sums.size());
  const auto part_of_edges = [](const Sums& sums) {
    return static_cast<double>(sums.edge_pixels) / static_cast<double>(sums.pixels) + kLeastEdges;
  };
  ParallelFor(pool, blocks->rows, [&](int64_t row) {
    for (int column = 0; column < blocks->columns; ++column) {
      Sums& block = blocks->At(column, static_cast<int>(row));
      if (block.pixels == 0) continue;
      const Sums around = SumAround(*blocks, column, static_cast<int>(row));
      const double noise = around.noise / static_cast<double>(around.pixels);
      const double detail = block.Detail();
      const double error = block.error / static_cast<double>(block.pixels);
      if (!(static_cast<float>(noise) > 0) || !(static_cast<float>(detail) > 0) ||
          !(static_cast<float>(error) > 0))
        continue;
      all[static_cast<size_t>(&block - blocks->sums.data())] = {
          &block,
          {LogOf(noise), LogOf(detail), LogOf(part_of_edges(block)), LogOf(part_of_edges(around))},
          LogOf(error) + kErrorDecline * LogOf(block.MeanSamples())};
    }
  });
  std::erase_if(all, [](const Point& point) { return point.block == nullptr; });
  return all;
}

/// A linear function of the traits, fitted to points by least squares, and the variance around it.
class Trend {
 public:
  explicit Trend(const std::vector<Point>& points) {
    const auto count = static_cast<double>(points.size());
    for (const Point& point : points) {
      traits_ += point.traits / count;
      error_ += point.error / count;
    }
    Eigen::Matrix<double, kTraits, kTraits> products = Eigen::Matrix<double, kTraits, kTraits>::Zero();
    Traits with_error = Traits::Zero();
    for (const Point& point : points) {
      const Traits off = point.traits - traits_;
      products += off * off.transpose();
      with_error += off * (point.error - error_);
    }
    // Traits that tell the same, or are the same everywhere, leave it singular: the least slopes then.
    Eigen::CompleteOrthogonalDecomposition<Eigen::Matrix<double, kTraits, kTraits>> solver;
    solver.setThreshold(1e-6);
    slopes_ = solver.compute(products).solve(with_error);
    for (const Point& point : points) {
      const double off = point.error - At(point);
      around_ += off * off / count;
    }
  }

  double At(const Point& point) const { return error_ + slopes_.dot(point.traits - traits_); }
  double around() const { return around_; }

 private:
  Traits traits_ = Traits::Zero();  // mean
  double error_ = 0;                // mean
  Traits slopes_ = Traits::Zero();
  double around_ = 0;
};

/// Draws the error of each block towards that of others of its traits; their sum stays.
void DrawTogether(Blocks* blocks, TaskPool* pool) {
  constexpr size_t kLeastPoints = 32;  // for slopes that are worth something
  const std::vector<Point> points = PointsOf(blocks, pool);
  if (points.size() < kLeastPoints) return;
  const Trend trend(points);
  if (!(trend.around() > 0)) return;
  const double share = std::min(1.0, kLogVarianceOfBlock / trend.around());
  double before = 0;
  double after = 0;
  for (const Point& point : points) {
    before += point.block->error;
    const double change = share * (trend.At(point) - point.error);
    point.block->error *= double{Exp(static_cast<float>(change))};
    after += point.block->error;
  }
  for (const Point& point : points) point.block->error *= before / after;
}

}  // namespace

ErrorEstimate EstimateError(const FilteredFilm& filtered, int block, ErrorMetric metric, TaskPool* pool) {
  LUMIFOLD_CHECK(block >= 1 && filtered.filtered.picture[0].width() == filtered.film.width() &&
                 filtered.filtered.deviation[0].width() == filtered.film.width());
  Blocks blocks = SumUp(filtered, block, metric, pool);
  ScaleToError(&blocks);
  FillUnmet(&blocks, pool);
  DrawTogether(&blocks, pool);
  ErrorEstimate estimate = {blocks.columns, blocks.rows, {}};
  for (const Sums& of_block : blocks.sums) {
    const double values = 3.0 * static_cast<double>(of_block.pixels);
    estimate.blocks.push_back(of_block.pixels == 0 ? -1.0 : of_block.error / values);
  }
  return estimate;
}

}  // namespace lumifold::metrics
