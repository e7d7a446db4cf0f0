#include "filter/edges/regression.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "absl/functional/function_ref.h"
#include "filter/edges/linear_fit.h"
#include "filter/image/portable_math.h"
#include "filter/kernels/box_mean.h"
#include "filter/layers/error_weight.h"
#include "filter/layers/magnitude.h"
#include "filter/layers/seen_surface.h"

namespace lumifold::filter {
namespace {

constexpr int kRadius = 6;  // 13x13 window
/// Models are fitted at every second pixel of every second row; pixels between take the mean of those around.
constexpr int kModelStep = 2;
constexpr float kMinModelWeight = 1;  // pixels with less weight of models around them are fitted themselves
constexpr int kErrorRadius = 3;       // window of the errors' means
constexpr float kSigmaPixels = 4;
constexpr float kSigmaSimilarity = 0.3f;  // of asinh(F / (kKnee * mean))
constexpr float kKnee = 0.2f;
constexpr float kMaxExponent = 4;  // weights below exp(-4) are left out of a window
/// Added to all errors, over C's variance, so that estimates that noise made small or negative decide
/// nothing.
constexpr float kMinError = 0.25f;
/// The same for F in mirrors off the edge set: the level was filtered by itself, and counts as right until
/// the halves show that it is not.
constexpr float kMinErrorOfLevels = 0.05f;
/// Sample count at which the fits and F get equal weight for equal estimated error; four times as many double
/// the fits' weight. F shares noise with the C that its error is estimated from, so its error is
/// underestimated; at few samples the fits are noisier than their errors show.
constexpr float kEqualTrustSamples = 64;
/// Glossy albedo above which nearly all light of a pixel is glossy: what it mirrors tells pixels apart, the
/// features that guide F do not.
constexpr float kMetallicAlbedo = 0.5f;
constexpr float kLogDistanceScale = 8;
constexpr float kMaxFeature = 10;
constexpr float kMaxSignal = 1e12f;  // C over its mean: fourth powers must stay finite

/// What the regression reads of one pixel.
struct Sample {
  FitSample fit;
  std::array<float, 3> similarity = {};  // asinh(F / kKnee)
  float light = 0;                       // mean of |F| over the channels
  bool is_usable = false;                // both halves are known and usable
};

/// Squared errors of the candidates, summed over the channels, estimated by the halves.
struct Errors {
  float unchanged = 0;  // F
  float corrected = 0;  // F plus the fit of C - F
  float refit = 0;      // the fit of C
  float variance = 0;   // of C
};

float Bounded(float x) { return std::isfinite(x) ? std::clamp(x, -kMaxFeature, kMaxFeature) : 0.0f; }

/// Reads samples of a frame and its filtered picture, all of which outlive it; light in units of `unit`.
class SampleReader {
 public:
  SampleReader(const Frame& frame, const SeenSurface& seen, const Planes& change, const Picture& picture,
               float unit)
      : frame_(frame), seen_(seen), change_(ViewOf(change)), picture_(ViewOf(picture)), unit_(unit) {}

  Sample At(int x, int y) const {
    Sample sample;
    SetTerms(x, y, &sample.fit.row);
    sample.is_usable = frame_.samples.HasBoth(x, y);
    for (size_t c = 0; c < 3; ++c) {
      const float f = picture_[c].At(x, y) / unit_;
      const float a = (frame_.combined.a[c].At(x, y) + change_[c].At(x, y)) / unit_;
      const float b = (frame_.combined.b[c].At(x, y) + change_[c].At(x, y)) / unit_;
      for (const float signal : {a, b, f})
        sample.is_usable = sample.is_usable && std::abs(signal) < kMaxSignal;
      sample.fit.row[c] = a;
      sample.fit.row[3 + c] = b;
      sample.fit.row[6 + c] = f;
      sample.fit.variance += (a - b) * (a - b) / 12;
      sample.fit.power += f * f / 3;
      sample.light += std::abs(f) / 3;
      sample.similarity[c] = Asinh(f * (1.0f / kKnee));
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
    if (distance > 0 && std::isfinite(distance)) terms[9] = kLogDistanceScale * Log(distance);
    if (!frame_.roughness.IsEmpty()) terms[10] = Bounded(frame_.roughness.At(x, y));
  }

  const Frame& frame_;
  const SeenSurface& seen_;
  ConstColorView change_, picture_;
  float unit_;
};

/// Half the squared distance between two pixels' F, in sigmas.
float Dissimilarity(const Sample& centre, const Sample& other) {
  float square = 0;
  for (size_t c = 0; c < 3; ++c) {
    const float difference = other.similarity[c] - centre.similarity[c];
    square += difference * difference;
  }
  return square * (1.0f / (2 * kSigmaSimilarity * kSigmaSimilarity));
}

/// The samples of a whole frame, and which pixels are fitted.
class SampleGrid {
 public:
  SampleGrid(const SampleReader& reader, const Plane& is_mixed, TaskPool* pool)
      : bounds_{0, 0, is_mixed.width(), is_mixed.height()},
        samples_(static_cast<size_t>(bounds_.width()) * static_cast<size_t>(bounds_.height())),
        model_of_(samples_.size(), kUnfitted) {
    ForEachPixel(pool, bounds_.width(), bounds_.height(),
                 [&](int x, int y) { samples_[IndexOf(x, y)] = reader.At(x, y); });
    ForEachPixel(bounds_.width(), bounds_.height(), [&](int x, int y) {
      if (!(is_mixed.At(x, y) > 0) || !At(x, y).is_usable) return;
      const bool has_model = x % kModelStep == 0 && y % kModelStep == 0;
      model_of_[IndexOf(x, y)] = has_model ? models_++ : kWithoutModel;
    });
  }

  const Sample& At(int x, int y) const { return samples_[IndexOf(x, y)]; }

  bool IsFitted(int x, int y) const { return model_of_[IndexOf(x, y)] != kUnfitted; }

  /// Index of the pixel's own model; below 0 where it has none.
  int ModelOf(int x, int y) const { return model_of_[IndexOf(x, y)]; }
  int models() const { return models_; }

  const Rect& bounds() const { return bounds_; }

 private:
  static constexpr int kUnfitted = -1;
  static constexpr int kWithoutModel = -2;  // fitted by the models around it

  size_t IndexOf(int x, int y) const {
    return static_cast<size_t>(y) * static_cast<size_t>(bounds_.width()) + static_cast<size_t>(x);
  }

  Rect bounds_;
  std::vector<Sample> samples_;
  std::vector<int> model_of_;
  int models_ = 0;
};

/// Calls body(i, j, weight) for the pixels of the window around (x, y), itself included, weighted by their
/// distance in the picture and by the similarity of F.
template <typename Body>
void ForEachSimilar(const SampleGrid& grid, int x, int y, const Body& body) {
  constexpr float kFalloff = 1.0f / (2 * kSigmaPixels * kSigmaPixels);
  const Rect window = Inflate({x, y, x + 1, y + 1}, kRadius, grid.bounds());
  for (int j = window.y0; j < window.y1; ++j) {
    for (int i = window.x0; i < window.x1; ++i) {
      const auto square = static_cast<float>((i - x) * (i - x) + (j - y) * (j - y));
      const float exponent = Dissimilarity(grid.At(x, y), grid.At(i, j)) + kFalloff * square;
      if (exponent < kMaxExponent) body(i, j, Exp(-exponent));
    }
  }
}

LinearModel FitAt(const SampleGrid& grid, int x, int y) {
  const FitSample& centre = grid.At(x, y).fit;
  LinearFit fit;
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

/// Half B judges the fit of half A, and the reverse. In mirrors off the edge set a pixel weighs less the
/// noisier it is: otherwise one bright sample would decide for all pixels around it, and the fit would put
/// back what was removed as a firefly.
Errors ErrorsOf(const Sample& sample, const std::array<float, kSignals>& fit, bool is_level) {
  Errors errors;
  const float weight = ErrorWeight(sample.light);
  for (size_t c = 0; c < 3; ++c) {
    const float a = sample.fit.row[c];
    const float b = sample.fit.row[3 + c];
    const float f = sample.fit.row[6 + c];
    const float fit_difference = fit[c] - fit[3 + c];
    const float noise = (a - b) * (a - b);
    const auto error_of = [&](float off_a, float off_b) {
      return weight * ((off_a * off_a + off_b * off_b - noise) / 2 - fit_difference * fit_difference / 4);
    };
    const float residual = f - fit[6 + c];  // of F by its own fit
    errors.unchanged += weight * (a - f) * (b - f);
    errors.corrected += error_of(fit[c] + residual - b, fit[3 + c] + residual - a);
    errors.refit += error_of(fit[c] - b, fit[3 + c] - a);
    errors.variance += weight * noise / 4;
  }
  if (!is_level) return errors;
  const float share = 1.0f / (1.0f + errors.variance);
  return {share * errors.unchanged, share * errors.corrected, share * errors.refit, share * errors.variance};
}

/// Weights of the two fits in the mixture; F unchanged has the rest.
struct Shares {
  float corrected = 0;
  float refit = 0;
};

/// Weights by inverse error, those of the fits times the trust that the sample count gives. All to F where no
/// error is known.
Shares SharesOf(const Errors& errors, float samples, bool is_level) {
  const float floor = kMinError * errors.variance;
  const float floor_of_f = is_level ? kMinErrorOfLevels * errors.variance : floor;
  const float unchanged = floor_of_f + std::max(errors.unchanged, 0.0f);
  if (!(unchanged > 0)) return {};
  const float corrected = floor + std::max(errors.corrected, 0.0f);
  const float refit = floor + std::max(errors.refit, 0.0f);
  const float smallest = std::min({unchanged, corrected, refit});
  const auto weight_of = [&](float error) { return error > smallest ? smallest / error : 1.0f; };
  const float trust = std::sqrt(samples / kEqualTrustSamples);
  const float total = weight_of(unchanged) + trust * (weight_of(corrected) + weight_of(refit));
  return {trust * weight_of(corrected) / total, trust * weight_of(refit) / total};
}

/// Which pixels are fitted: those of the edge set and the diffuse surfaces next to them, metals, and those
/// that show a level. 1 or 0.
struct MixedPixels {
  Plane is_mixed;  // any of them
  Plane is_level;  // they show a level and are off the edge set

  explicit MixedPixels(const Frame& frame)
      : is_mixed(frame.level_mask.Clone()), is_level(frame.level_mask.Clone()) {
    AddEdges(frame);
    AddMetals(frame);
  }

 private:
  void AddEdges(const Frame& frame) {
    if (!frame.edges.has_value()) return;
    frame.edges->ForEachPixel(frame.bounds(), [&](int, int x, int y) {
      is_mixed.At(x, y) = 1;
      is_level.At(x, y) = 0;
      const Rect around = Inflate({x, y, x + 1, y + 1}, 1, frame.bounds());
      for (int j = around.y0; j < around.y1; ++j) {
        for (int i = around.x0; i < around.x1; ++i) {
          if (frame.surface.mask.At(i, j) > 0) is_mixed.At(i, j) = 1;
        }
      }
    });
  }

  void AddMetals(const Frame& frame) {
    const ConstColorView& glossy = frame.glossy_albedo;
    if (glossy[0].IsEmpty()) return;
    ForEachPixel(frame.width, frame.height, [&](int x, int y) {
      if (LuminanceAt(glossy, x, y) > kMetallicAlbedo) is_mixed.At(x, y) = 1;
    });
  }
};

/// Calls body(x, y) for each pixel that is fitted.
void ForEachFitted(const SampleGrid& grid, TaskPool* pool, absl::FunctionRef<void(int, int)> body) {
  ForEachPixel(pool, grid.bounds().width(), grid.bounds().height(), [&](int x, int y) {
    if (grid.IsFitted(x, y)) body(x, y);
  });
}

/// The fits of all pixels that are fitted, in units of the picture's mean.
struct Fits {
  Plane is_fitted;   // 1 or 0
  Planes corrected;  // 3: F plus the fit of C - F, minus F
  Planes refit;      // 3: the fit of C, minus F
  Planes errors;     // unchanged, corrected, refit, variance
};

Fits FitAll(const SampleReader& reader, const MixedPixels& pixels, TaskPool* pool) {
  const SampleGrid grid(reader, pixels.is_mixed, pool);
  std::vector<LinearModel> models(static_cast<size_t>(grid.models()));
  ForEachFitted(grid, pool, [&](int x, int y) {
    if (grid.ModelOf(x, y) >= 0) models[static_cast<size_t>(grid.ModelOf(x, y))] = FitAt(grid, x, y);
  });
  const int width = pixels.is_mixed.width();
  const int height = pixels.is_mixed.height();
  Fits fits{Plane(width, height), MakePlanes(3, width, height), MakePlanes(3, width, height),
            MakePlanes(4, width, height)};
  ForEachFitted(grid, pool, [&](int x, int y) {
    const std::array<float, kSignals> fit = MeanFitAt(grid, models, x, y);
    const Sample& sample = grid.At(x, y);
    for (size_t c = 0; c < 3; ++c) {
      const float mean = 0.5f * (fit[c] + fit[3 + c]);
      fits.corrected[c].At(x, y) = mean - fit[6 + c];
      fits.refit[c].At(x, y) = mean - sample.fit.row[6 + c];
    }
    const Errors errors = ErrorsOf(sample, fit, pixels.is_level.At(x, y) > 0);
    fits.errors[0].At(x, y) = errors.unchanged;
    fits.errors[1].At(x, y) = errors.corrected;
    fits.errors[2].At(x, y) = errors.refit;
    fits.errors[3].At(x, y) = errors.variance;
    fits.is_fitted.At(x, y) = 1;
  });
  return fits;
}

}  // namespace

int RegressionWindow() { return 2 * kRadius + kErrorRadius; }

void RegressEdges(const Frame& frame, const Planes& coverage_change, TaskPool* pool, Picture* picture) {
  const float unit = MeanMagnitude(frame.combined.mean, pool);
  if (!(unit > 0)) return;
  const SeenSurface seen = SeenSurfaceOf(frame, pool);
  const MixedPixels pixels(frame);
  const Fits fits = FitAll(SampleReader(frame, seen, coverage_change, *picture, unit), pixels, pool);
  const Planes means = BoxMeans(fits.errors, fits.is_fitted.view(), kErrorRadius, pool);
  ForEachPixel(pool, frame.width, frame.height, [&](int x, int y) {
    if (fits.is_fitted.At(x, y) == 0) return;
    const Errors errors = {means[0].At(x, y), means[1].At(x, y), means[2].At(x, y), means[3].At(x, y)};
    const Shares shares = SharesOf(errors, frame.samples.At(x, y), pixels.is_level.At(x, y) > 0);
    for (size_t c = 0; c < 3; ++c) {
      (*picture)[c].At(x, y) +=
          unit * (shares.corrected * fits.corrected[c].At(x, y) + shares.refit * fits.refit[c].At(x, y));
    }
  });
}

}  // namespace lumifold::filter
