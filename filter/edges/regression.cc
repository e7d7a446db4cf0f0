#include "filter/edges/regression.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "absl/functional/function_ref.h"
#include "filter/edges/linear_fit.h"
#include "filter/image/portable_math.h"
#include "filter/kernels/box_mean.h"
#include "filter/layers/magnitude.h"
#include "filter/layers/seen_surface.h"

namespace lumifold::filter {
namespace {

/// Models are fitted at every second pixel of every second row; pixels between take the mean of those around.
constexpr int kModelStep = 2;
constexpr float kMinModelWeight = 1;  // pixels with less weight of models around them are fitted themselves
constexpr float kMaxExponent = 4;     // weights below exp(-4) are left out of a window
constexpr float kMaxFeature = 10;
constexpr float kMaxSignal = 1e12f;  // C over its mean: fourth powers must stay finite

/// What the regression reads of one pixel.
struct Sample {
  FitSample fit;
  std::array<float, 3> similarity = {};  // asinh(F / knee) / sigma_light
  bool is_usable = false;                // both halves are known and usable
};

float Bounded(float x) { return std::isfinite(x) ? std::clamp(x, -kMaxFeature, kMaxFeature) : 0.0f; }

int RadiusOf(const RegressionParams& params) { return static_cast<int>(std::lround(1.5f * params.sigma_px)); }

/// Reads samples of a frame and its filtered picture, all of which outlive it; light in units of `unit`.
class SampleReader {
 public:
  SampleReader(const Frame& frame, const SeenSurface& seen, const FrameChange& change, float sigma_light,
               float knee, const GeometryRanges& ranges, float unit)
      : frame_(frame),
        seen_(seen),
        change_{ViewOf(change[0]), ViewOf(change[1])},
        inverse_sigma_(1.0f / sigma_light),
        inverse_knee_(1.0f / knee),
        ranges_(ranges),
        unit_(unit) {}

  Sample At(int x, int y) const {
    Sample sample;
    SetTerms(x, y, &sample.fit.row);
    sample.is_usable = frame_.samples.HasBoth(x, y);
    for (size_t c = 0; c < 3; ++c) {
      const float a = frame_.combined.a[c].At(x, y) / unit_;
      const float b = frame_.combined.b[c].At(x, y) / unit_;
      const float change_a = change_[0][c].At(x, y) / unit_;
      const float change_b = change_[1][c].At(x, y) / unit_;
      const float share = frame_.samples.ShareA(x, y);
      const float f = share * (a + change_a) + (1.0f - share) * (b + change_b);
      for (const float signal : {a, b, f})
        sample.is_usable = sample.is_usable && std::abs(signal) < kMaxSignal;
      sample.fit.row[c] = a;
      sample.fit.row[3 + c] = b;
      sample.fit.row[6 + c] = -change_a;
      sample.fit.row[9 + c] = -change_b;
      sample.fit.variance += (a - b) * (a - b) / 12;
      sample.fit.power += f * f / 3;
      sample.similarity[c] = Asinh(f * inverse_knee_) * inverse_sigma_;
    }
    return sample;
  }

 private:
  void SetTerms(int x, int y, std::array<float, kRowSize>* row) const {
    float* terms = row->data() + kSignals;
    terms[0] = 1;
    for (size_t c = 0; c < 3; ++c) {
      terms[1 + c] = Bounded(seen_.albedo[c].At(x, y));
      terms[4 + c] = Bounded(seen_.normal[c].At(x, y));
    }
    terms[7] = Bounded(seen_.mask.At(x, y));
    const ConstColorView& glossy = frame_.glossy_albedo;
    if (!glossy[0].IsEmpty()) terms[8] = Bounded(LuminanceAt(glossy, x, y));
    const float distance = seen_.distance.At(x, y);
    if (distance > 0 && std::isfinite(distance)) terms[9] = Log(distance) / ranges_.log_depth;
    if (!frame_.roughness.IsEmpty()) terms[10] = Bounded(frame_.roughness.At(x, y));
  }

  const Frame& frame_;
  const SeenSurface& seen_;
  std::array<ConstColorView, 2> change_;
  float inverse_sigma_;
  float inverse_knee_;
  const GeometryRanges& ranges_;
  float unit_;
};

/// Half the squared distance between two pixels' F, in sigmas.
float Dissimilarity(const Sample& centre, const Sample& other) {
  float square = 0;
  for (size_t c = 0; c < 3; ++c) {
    const float difference = other.similarity[c] - centre.similarity[c];
    square += difference * difference;
  }
  return 0.5f * square;
}

/// The samples of the pixels in the windows of those that are fitted.
class SampleGrid {
 public:
  SampleGrid(const SampleReader& reader, const Plane& is_mixed, const RegressionParams& params,
             TaskPool* pool)
      : params_(params),
        bounds_{0, 0, is_mixed.width(), is_mixed.height()},
        sample_of_(static_cast<size_t>(bounds_.width()) * static_cast<size_t>(bounds_.height()), kOutside),
        model_of_(sample_of_.size(), kUnfitted) {
    const std::vector<std::array<int, 2>> read = PixelsInWindows(is_mixed);
    samples_.resize(read.size());
    for (size_t i = 0; i < read.size(); ++i)
      sample_of_[IndexOf(read[i][0], read[i][1])] = static_cast<int32_t>(i);
    ParallelFor(pool, (static_cast<int64_t>(read.size()) + kPixelsPerTask - 1) / kPixelsPerTask,
                [&](int64_t task) {
                  const size_t first = static_cast<size_t>(task) * kPixelsPerTask;
                  for (size_t i = first; i < std::min(first + kPixelsPerTask, read.size()); ++i)
                    samples_[i] = reader.At(read[i][0], read[i][1]);
                });
    ForEachPixel(bounds_.width(), bounds_.height(), [&](int x, int y) {
      if (!(is_mixed.At(x, y) > 0) || !At(x, y).is_usable) return;
      const bool has_model = x % kModelStep == 0 && y % kModelStep == 0;
      model_of_[IndexOf(x, y)] = has_model ? models_++ : kWithoutModel;
    });
  }

  /// Of a pixel in the window of a fitted one.
  const Sample& At(int x, int y) const { return samples_[static_cast<size_t>(sample_of_[IndexOf(x, y)])]; }

  bool IsFitted(int x, int y) const { return model_of_[IndexOf(x, y)] != kUnfitted; }

  /// Index of the pixel's own model; below 0 where it has none.
  int ModelOf(int x, int y) const { return model_of_[IndexOf(x, y)]; }
  int models() const { return models_; }

  const RegressionParams& params() const { return params_; }
  const Rect& bounds() const { return bounds_; }

 private:
  static constexpr int32_t kOutside = -1;
  static constexpr int kUnfitted = -1;
  static constexpr int kWithoutModel = -2;  // fitted by the models around it
  static constexpr int64_t kPixelsPerTask = 4096;

  size_t IndexOf(int x, int y) const {
    return static_cast<size_t>(y) * static_cast<size_t>(bounds_.width()) + static_cast<size_t>(x);
  }

  std::vector<std::array<int, 2>> PixelsInWindows(const Plane& is_mixed) const {
    // Part of the window that is mixed; the sums of exact zeros are 0.
    Planes mixed;
    mixed.push_back(is_mixed.Clone());
    const Plane ones = MakePlane(bounds_.width(), bounds_.height(), 1.0f);
    const Plane near = std::move(BoxMeans(mixed, ones.view(), RadiusOf(params_), nullptr)[0]);
    std::vector<std::array<int, 2>> pixels;
    ForEachPixel(bounds_.width(), bounds_.height(), [&](int x, int y) {
      if (near.At(x, y) > 0) pixels.push_back({x, y});
    });
    return pixels;
  }

  const RegressionParams params_;
  Rect bounds_;
  std::vector<int32_t> sample_of_;  // of each pixel
  std::vector<Sample> samples_;
  std::vector<int> model_of_;
  int models_ = 0;
};

/// Calls body(i, j, weight) for the pixels of the window around (x, y), itself included, weighted by their
/// distance in the picture and by the similarity of F.
template <typename Body>
void ForEachSimilar(const SampleGrid& grid, int x, int y, const Body& body) {
  const float sigma = grid.params().sigma_px;
  const float falloff = 1.0f / (2 * sigma * sigma);
  const Rect window = Inflate({x, y, x + 1, y + 1}, RadiusOf(grid.params()), grid.bounds());
  for (int j = window.y0; j < window.y1; ++j) {
    for (int i = window.x0; i < window.x1; ++i) {
      const auto square = static_cast<float>((i - x) * (i - x) + (j - y) * (j - y));
      const float exponent = Dissimilarity(grid.At(x, y), grid.At(i, j)) + falloff * square;
      if (exponent < kMaxExponent) body(i, j, Exp(-exponent));
    }
  }
}

LinearModel FitAt(const SampleGrid& grid, int x, int y) {
  const FitSample& centre = grid.At(x, y).fit;
  LinearFit fit(grid.params().slope);
  ForEachSimilar(grid, x, y, [&](int i, int j, float weight) {
    if (grid.At(i, j).is_usable) fit.Add(grid.At(i, j).fit, centre, weight);
  });
  return fit.Solve(centre);
}

/// The signals at (x, y) by the weighted mean of the models around it.
std::array<float, kSignals> MeanFitAt(const SampleGrid& grid, const std::vector<LinearModel>& models, int x,
                                      int y) {
  LinearModel sum = {};
  float total = 0;
  const auto add = [&](const LinearModel& model, float weight) {
    total += weight;
    for (size_t k = 0; k < sum.size(); ++k) sum[k] += weight * model[k];
  };
  ForEachSimilar(grid, x, y, [&](int i, int j, float weight) {
    if (grid.ModelOf(i, j) >= 0) add(models[static_cast<size_t>(grid.ModelOf(i, j))], weight);
  });
  if (grid.ModelOf(x, y) < 0 && total < kMinModelWeight) add(FitAt(grid, x, y), 1);
  std::array<float, kSignals> fit = {};
  for (size_t i = 0; i < kTerms; ++i) {
    const float term = grid.At(x, y).fit.row[kSignals + i] / total;
    for (size_t s = 0; s < kSignals; ++s) fit[s] += term * sum[i * kSignals + s];
  }
  return fit;
}

/// Calls body(x, y) for each pixel that is fitted.
void ForEachFitted(const SampleGrid& grid, TaskPool* pool, absl::FunctionRef<void(int, int)> body) {
  ForEachPixel(pool, grid.bounds().width(), grid.bounds().height(), [&](int x, int y) {
    if (grid.IsFitted(x, y)) body(x, y);
  });
}

}  // namespace

int RegressionWindow(const RegressionParams& params) { return 2 * RadiusOf(params); }

std::vector<FrameChange> FitMixedPixels(const Frame& frame, const Plane& mixed, const FrameChange& change,
                                        const RegressionParams& params, float knee,
                                        const GeometryRanges& ranges, TaskPool* pool) {
  const float unit = MeanMagnitude(frame.combined.mean, pool);
  if (!(unit > 0)) return {};
  const SeenSurface seen = SeenSurfaceOf(frame, pool);
  const SampleReader reader(frame, seen, change, params.sigma_light, knee, ranges, unit);
  const SampleGrid grid(reader, mixed, params, pool);
  std::vector<LinearModel> models(static_cast<size_t>(grid.models()));
  ForEachFitted(grid, pool, [&](int x, int y) {
    if (grid.ModelOf(x, y) >= 0) models[static_cast<size_t>(grid.ModelOf(x, y))] = FitAt(grid, x, y);
  });
  // Off the fitted pixels both are the picture itself.
  FrameChange corrected = {Clone(change[0]), Clone(change[1])};
  FrameChange refit = {Clone(change[0]), Clone(change[1])};
  ForEachFitted(grid, pool, [&](int x, int y) {
    const std::array<float, kSignals> fit = MeanFitAt(grid, models, x, y);
    const Sample& sample = grid.At(x, y);
    for (size_t h = 0; h < 2; ++h) {
      for (size_t c = 0; c < 3; ++c) {
        corrected[h][c].At(x, y) += unit * fit[6 + 3 * h + c];
        refit[h][c].At(x, y) = unit * (fit[3 * h + c] - sample.fit.row[3 * h + c]);
      }
    }
  });
  std::vector<FrameChange> candidates;
  candidates.push_back(std::move(corrected));
  candidates.push_back(std::move(refit));
  return candidates;
}

}  // namespace lumifold::filter
