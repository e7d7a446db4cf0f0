#include "filter/edges/regression.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "filter/edges/edge_pixels.h"
#include "filter/image/color.h"
#include "filter/image/layers.h"
#include "filter/image/level_mask.h"
#include "filter/image/portable_math.h"
#include "filter/kernels/box_mean.h"
#include "filter/layers/error_weight.h"
#include "filter/layers/recombine.h"
#include "filter/layers/seen_surface.h"

namespace lumifold::filter {
namespace {

constexpr int kRadius = 6;  // 13x13 window
/// Functions are fitted at every second pixel of every second row: pixels between have them from those about.
constexpr int kFitStep = 2;
constexpr float kLeastModels = 1;  // a pixel with less weight of functions about it is fitted by itself
constexpr int kTrustRadius = 3;    // of the errors' means
constexpr float kSigmaPixels = 4;
constexpr float kSigmaLikeness = 0.3f;  // in units of asinh(F / (kKnee mean))
constexpr float kKnee = 0.2f;
/// What counts for less than e to the minus this in a window is left out of it.
constexpr float kMostExponent = 4;
/// What is expected of a term before any pixel is seen: over its unit, C changes by so many times F.
constexpr float kExpectedSlope = 4;
constexpr float kLeastLight = 1e-3f;  // of the mean's square: F^2 counts as no less
constexpr float kLeastRidge = 1e-5f;  // of the window's weight
constexpr float kMostRidge = 1;       // of the same
/// Of C's variance: what is added to all errors, so that estimates that noise made small or negative decide
/// nothing.
constexpr float kLeastError = 0.25f;
/// The same of F's error in mirrors off the edge set: what is seen there was filtered by itself, and is taken
/// to be right until the halves say that it is not.
constexpr float kLeastErrorOfLevels = 0.05f;
/// As many samples make a fit count as much as F where both err alike; four times as many, twice as much: F
/// has noise in common with the C that its error is estimated from and looks better than it is, and few
/// samples leave the fits noisier than their pixels' errors tell.
constexpr float kSamplesOfTrust = 64;
/// Where S is more than this, nearly all light is glossy, and what it mirrors tells pixels apart: the
/// features that guide F do not.
constexpr float kMetallic = 0.5f;
constexpr float kTermsOfLogDistance = 8;
constexpr float kLargestFeature = 10;
constexpr float kLargest = 1e12f;  // of C over its mean: squares of squares must stay finite

constexpr size_t kTerms = 11;   // 1, T, normal, covered part, S, log distance, roughness
constexpr size_t kSignals = 9;  // C of half A and of half B, F
constexpr size_t kRowSize = kTerms + kSignals;

/// What the regression needs of one pixel.
struct Sample {
  std::array<float, kRowSize> row = {};  // signals, then terms
  std::array<float, 3> likeness = {};
  float variance = 0;      // of C, mean over the channels
  float light = 0;         // mean of |F|
  float power = 0;         // mean of F^2
  bool is_usable = false;  // both halves known and finite
};

/// The signals as linear functions of the terms: term by term a factor for each signal.
using Model = std::array<float, kTerms * kSignals>;

/// Squared errors, summed over the channels, by the halves.
struct Errors {
  float kept = 0;      // of F as it is
  float mended = 0;    // of F and the fit of C - F
  float anew = 0;      // of the fit of C
  float variance = 0;  // of C
};

float Bounded(float x) { return std::isfinite(x) ? std::clamp(x, -kLargestFeature, kLargestFeature) : 0.0f; }

/// Reads samples out of a film and its filtered picture, all of which outlive it; light in units of `unit`.
class Source {
 public:
  Source(const LayeredImage& film, const SeenSurface& seen, const Planes& change,
         const std::array<Plane, 3>& picture, float unit)
      : a_(film.GetColor(layers::HalfA(layers::kNoisy))),
        b_(film.GetColor(layers::HalfB(layers::kNoisy))),
        n_a_(film.Get(layers::kSamplesA)),
        n_b_(film.Get(layers::kSamplesB)),
        seen_(seen),
        change_(ViewOf(change)),
        picture_{picture[0].view(), picture[1].view(), picture[2].view()},
        unit_(unit) {
    if (film.HasColor(layers::kGlossyAlbedo)) glossy_albedo_ = film.GetColor(layers::kGlossyAlbedo);
    if (film.Has(layers::kRoughness)) roughness_ = film.Get(layers::kRoughness);
  }

  Sample At(int x, int y) const {
    Sample sample;
    SetTerms(x, y, &sample);
    sample.is_usable = n_a_.At(x, y) > 0 && n_b_.At(x, y) > 0;
    for (size_t c = 0; c < 3; ++c) {
      const float f = picture_[c].At(x, y) / unit_;
      const float a = (a_[c].At(x, y) + change_[c].At(x, y)) / unit_;
      const float b = (b_[c].At(x, y) + change_[c].At(x, y)) / unit_;
      for (const float signal : {a, b, f}) sample.is_usable = sample.is_usable && std::abs(signal) < kLargest;
      sample.row[c] = a;
      sample.row[3 + c] = b;
      sample.row[6 + c] = f;
      sample.variance += (a - b) * (a - b) / 12;
      sample.light += std::abs(f) / 3;
      sample.power += f * f / 3;
      sample.likeness[c] = Asinh(f * (1.0f / kKnee));
    }
    return sample;
  }

 private:
  void SetTerms(int x, int y, Sample* sample) const {
    sample->row[kSignals] = 1;
    for (size_t c = 0; c < 3; ++c) {
      sample->row[kSignals + 1 + c] = Bounded(seen_.albedo[c].At(x, y));
      sample->row[kSignals + 4 + c] = Bounded(seen_.normal[c].At(x, y));
    }
    sample->row[kSignals + 7] = Bounded(seen_.mask.At(x, y));
    if (!glossy_albedo_[0].IsEmpty()) {
      sample->row[kSignals + 8] = Bounded(
          Luminance(glossy_albedo_[0].At(x, y), glossy_albedo_[1].At(x, y), glossy_albedo_[2].At(x, y)));
    }
    const float distance = seen_.distance.At(x, y);
    if (distance > 0 && std::isfinite(distance))
      sample->row[kSignals + 9] = kTermsOfLogDistance * Log(distance);
    if (!roughness_.IsEmpty()) sample->row[kSignals + 10] = Bounded(roughness_.At(x, y));
  }

  ConstColorView a_, b_;
  ConstFloatView n_a_, n_b_;
  const SeenSurface& seen_;
  ConstColorView glossy_albedo_;
  ConstFloatView roughness_;
  ConstColorView change_, picture_;
  float unit_;
};

/// Weighted least squares over samples whose terms are counted from those of the pixel in the middle. A slope
/// is drawn to 0 by what is expected of it, the more the noisier the samples are: Bayesian linear regression.
class Fit {
 public:
  void Add(const Sample& sample, const Sample& centre, float weight) {
    variance_ += weight * sample.variance;
    power_ += weight * sample.power;
    std::array<float, kRowSize> row = sample.row;
    for (size_t i = 1; i < kTerms; ++i) row[kSignals + i] -= centre.row[kSignals + i];
    for (size_t i = 0; i < kTerms; ++i) AddTimes(weight * row[kSignals + i], row, i);
  }

  /// Of terms counted from 0. Consumes the sums.
  Model Solve(const Sample& centre) {
    const float ridge = Ridge();
    for (size_t i = 1; i < kTerms; ++i) sums_[i][kSignals + i] += ridge;
    // Elimination from the last term up to the constant, whose row then stands alone. It needs no pivots: the
    // ridge keeps the matrix positive definite.
    for (size_t k = kTerms - 1; k > 0; --k) {
      const float inverse = 1.0f / sums_[k][kSignals + k];
      for (size_t i = 0; i < k; ++i) AddTimes(-sums_[k][kSignals + i] * inverse, sums_[k], i);
    }
    Model model = {};
    for (size_t i = 0; i < kTerms; ++i) {
      const float inverse = 1.0f / sums_[i][kSignals + i];
      for (size_t s = 0; s < kSignals; ++s) {
        float right = sums_[i][s];
        for (size_t j = 0; j < i; ++j) right -= sums_[i][kSignals + j] * model[j * kSignals + s];
        model[i * kSignals + s] = right * inverse;
      }
    }
    for (size_t i = 1; i < kTerms; ++i) {
      for (size_t s = 0; s < kSignals; ++s) model[s] -= model[i * kSignals + s] * centre.row[kSignals + i];
    }
    return model;
  }

 private:
  /// The samples' variance over the square of what is expected of a slope.
  float Ridge() const {
    const float weight = sums_[0][kSignals];
    const float expected = kExpectedSlope * kExpectedSlope * (power_ + kLeastLight * weight);
    return std::min(variance_ / expected, kMostRidge * weight) + kLeastRidge * weight;
  }

  /// Adds to the sums of term i. The matrix is symmetric: columns of later terms are left out, but for what
  /// fills vectors.
  void AddTimes(float by, const std::array<float, kRowSize>& row, size_t i) {
    constexpr size_t kLanes = 4;
    for (size_t j = 0; j <= kSignals + i; j += kLanes) {
      for (size_t k = j; k < j + kLanes; ++k) sums_[i][k] += by * row[k];
    }
  }

  std::array<std::array<float, kRowSize>, kTerms> sums_ = {};
  float variance_ = 0;
  float power_ = 0;
};

/// Half the square of how far apart the two pixels' F are, in sigmas.
float Unlikeness(const Sample& centre, const Sample& other) {
  float square = 0;
  for (size_t c = 0; c < 3; ++c) {
    const float difference = other.likeness[c] - centre.likeness[c];
    square += difference * difference;
  }
  return square * (1.0f / (2 * kSigmaLikeness * kSigmaLikeness));
}

/// The samples of a whole frame, and the pixels that are fitted.
class Frame {
 public:
  Frame(const Source& source, const Plane& is_mixed, TaskPool* pool)
      : bounds_{0, 0, is_mixed.width(), is_mixed.height()},
        samples_(static_cast<size_t>(bounds_.width()) * static_cast<size_t>(bounds_.height())),
        model_of_(samples_.size(), kUnfitted) {
    ForEachBand(pool, bounds_.height(), [&](int, int y0, int y1) {
      for (int y = y0; y < y1; ++y) {
        for (int x = 0; x < bounds_.x1; ++x) samples_[IndexOf(x, y)] = source.At(x, y);
      }
    });
    for (int y = 0; y < bounds_.y1; ++y) {
      for (int x = 0; x < bounds_.x1; ++x) {
        if (!(is_mixed.At(x, y) > 0) || !At(x, y).is_usable) continue;
        const bool has_model = x % kFitStep == 0 && y % kFitStep == 0;
        model_of_[IndexOf(x, y)] = has_model ? models_++ : kOfOthers;
      }
    }
  }

  const Sample& At(int x, int y) const { return samples_[IndexOf(x, y)]; }

  bool IsFitted(int x, int y) const { return model_of_[IndexOf(x, y)] != kUnfitted; }

  /// Which of the models is the pixel's; below 0 where it has none of its own.
  int ModelOf(int x, int y) const { return model_of_[IndexOf(x, y)]; }
  int models() const { return models_; }

  const Rect& bounds() const { return bounds_; }

 private:
  static constexpr int kUnfitted = -1;
  static constexpr int kOfOthers = -2;  // the pixel has the functions of those about it

  size_t IndexOf(int x, int y) const {
    return static_cast<size_t>(y) * static_cast<size_t>(bounds_.width()) + static_cast<size_t>(x);
  }

  Rect bounds_;
  std::vector<Sample> samples_;
  std::vector<int> model_of_;
  int models_ = 0;
};

/// Calls body(i, j, weight) for the pixels about (x, y), itself among them, that count for it: the less the
/// farther away and the more unlike they are.
template <typename Body>
void ForEachAlike(const Frame& frame, int x, int y, const Body& body) {
  constexpr float kNearness = 1.0f / (2 * kSigmaPixels * kSigmaPixels);
  const Rect window = Inflate({x, y, x + 1, y + 1}, kRadius, frame.bounds());
  for (int j = window.y0; j < window.y1; ++j) {
    for (int i = window.x0; i < window.x1; ++i) {
      const auto apart = static_cast<float>((i - x) * (i - x) + (j - y) * (j - y));
      const float exponent = Unlikeness(frame.At(x, y), frame.At(i, j)) + kNearness * apart;
      if (exponent < kMostExponent) body(i, j, Exp(-exponent));
    }
  }
}

/// What the pixels about (x, y) that look alike leave there.
Model FitAt(const Frame& frame, int x, int y) {
  const Sample& centre = frame.At(x, y);
  Fit fit;
  ForEachAlike(frame, x, y, [&](int i, int j, float weight) {
    if (frame.At(i, j).is_usable) fit.Add(frame.At(i, j), centre, weight);
  });
  return fit.Solve(centre);
}

/// What the models fitted about (x, y) say of it in the mean.
std::array<float, kSignals> MeanFitAt(const Frame& frame, const std::vector<Model>& models, int x, int y) {
  Model sum = {};
  float total = 0;
  const auto add = [&](const Model& model, float weight) {
    total += weight;
    for (size_t k = 0; k < sum.size(); ++k) sum[k] += weight * model[k];
  };
  ForEachAlike(frame, x, y, [&](int i, int j, float weight) {
    if (frame.ModelOf(i, j) >= 0) add(models[static_cast<size_t>(frame.ModelOf(i, j))], weight);
  });
  if (frame.ModelOf(x, y) < 0 && total < kLeastModels) add(FitAt(frame, x, y), 1);
  std::array<float, kSignals> fit = {};
  for (size_t i = 0; i < kTerms; ++i) {
    const float term = frame.At(x, y).row[kSignals + i] / total;
    for (size_t s = 0; s < kSignals; ++s) fit[s] += term * sum[i * kSignals + s];
  }
  return fit;
}

/// Half B judges what half A was fitted by, and the reverse. In mirrors off the edge set a pixel counts the
/// less the noisier it is: one bright sample would otherwise decide for all about it, and the fit put back
/// what was taken out of it as a firefly.
Errors ErrorsOf(const Sample& sample, const std::array<float, kSignals>& fit, bool is_level) {
  Errors errors;
  const float weight = ErrorWeight(sample.light);
  for (size_t c = 0; c < 3; ++c) {
    const float a = sample.row[c];
    const float b = sample.row[3 + c];
    const float f = sample.row[6 + c];
    const float apart = fit[c] - fit[3 + c];
    const float noise = (a - b) * (a - b);
    const auto error_of = [&](float off_a, float off_b) {
      return weight * ((off_a * off_a + off_b * off_b - noise) / 2 - apart * apart / 4);
    };
    const float left = f - fit[6 + c];  // of F by its own fit
    errors.kept += weight * (a - f) * (b - f);
    errors.mended += error_of(fit[c] + left - b, fit[3 + c] + left - a);
    errors.anew += error_of(fit[c] - b, fit[3 + c] - a);
    errors.variance += weight * noise / 4;
  }
  if (!is_level) return errors;
  const float share = 1.0f / (1.0f + errors.variance);
  return {share * errors.kept, share * errors.mended, share * errors.anew, share * errors.variance};
}

/// How far the fits are followed in place of F.
struct Shares {
  float mended = 0;
  float anew = 0;
};

/// By the inverse errors; by the number of samples for how far these are believed. F is all where nothing is
/// known to be wrong with it.
Shares SharesOf(const Errors& errors, float samples, bool is_level) {
  const float least = kLeastError * errors.variance;
  const float least_kept = is_level ? kLeastErrorOfLevels * errors.variance : least;
  const float kept = least_kept + std::max(errors.kept, 0.0f);
  if (!(kept > 0)) return {};
  const float mended = least + std::max(errors.mended, 0.0f);
  const float anew = least + std::max(errors.anew, 0.0f);
  const float smallest = std::min({kept, mended, anew});
  const auto weight_of = [&](float error) { return error > smallest ? smallest / error : 1.0f; };
  const float trust = std::sqrt(samples / kSamplesOfTrust);
  const float total = weight_of(kept) + trust * (weight_of(mended) + weight_of(anew));
  return {trust * weight_of(mended) / total, trust * weight_of(anew) / total};
}

/// Which pixels are fitted: those of the edge set and next to them, but for sky and lamps there, metals, and
/// those that show a level. 1 or 0.
struct MixedPixels {
  Plane is_mixed;  // any
  Plane is_level;  // they show a level and are off the edge set

  MixedPixels(const LayeredImage& film, const LayeredImage* edges)
      : is_mixed(LevelMask(film)), is_level(is_mixed.Clone()) {
    AddEdges(film, edges);
    AddMetals(film);
  }

 private:
  void AddEdges(const LayeredImage& film, const LayeredImage* edges) {
    const ConstFloatView mask = film.Get(layers::kMask);
    ForEachEdgePixel(edges, film.bounds(), [&](int, int x, int y) {
      is_mixed.At(x, y) = 1;
      is_level.At(x, y) = 0;
      const Rect about = Inflate({x, y, x + 1, y + 1}, 1, film.bounds());
      for (int j = about.y0; j < about.y1; ++j) {
        for (int i = about.x0; i < about.x1; ++i) {
          if (mask.At(i, j) > 0) is_mixed.At(i, j) = 1;
        }
      }
    });
  }

  void AddMetals(const LayeredImage& film) {
    if (!film.HasColor(layers::kGlossyAlbedo)) return;
    const ConstColorView glossy_albedo = film.GetColor(layers::kGlossyAlbedo);
    for (int y = 0; y < film.height(); ++y) {
      for (int x = 0; x < film.width(); ++x) {
        if (Luminance(glossy_albedo[0].At(x, y), glossy_albedo[1].At(x, y), glossy_albedo[2].At(x, y)) >
            kMetallic)
          is_mixed.At(x, y) = 1;
      }
    }
  }
};

/// Calls body(x, y) for each pixel that is fitted.
void ForEachFitted(const Frame& frame, TaskPool* pool, absl::FunctionRef<void(int, int)> body) {
  ForEachBand(pool, frame.bounds().height(), [&](int, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      for (int x = 0; x < frame.bounds().x1; ++x) {
        if (frame.IsFitted(x, y)) body(x, y);
      }
    }
  });
}

/// The fits of all pixels that are fitted, in the source's units.
struct Fits {
  Plane is_fitted;     // 1 or 0
  Planes corrections;  // 3 of F and the fit of C - F, then 3 of the fit of C: what they are more than F
  Planes errors;       // kept, mended, anew, variance
};

Fits FitAll(const Source& source, const MixedPixels& pixels, TaskPool* pool) {
  const Frame frame(source, pixels.is_mixed, pool);
  std::vector<Model> models(static_cast<size_t>(frame.models()));
  ForEachFitted(frame, pool, [&](int x, int y) {
    if (frame.ModelOf(x, y) >= 0) models[static_cast<size_t>(frame.ModelOf(x, y))] = FitAt(frame, x, y);
  });
  const int width = pixels.is_mixed.width();
  const int height = pixels.is_mixed.height();
  Fits fits{Plane(width, height), MakePlanes(6, width, height), MakePlanes(4, width, height)};
  ForEachFitted(frame, pool, [&](int x, int y) {
    const std::array<float, kSignals> fit = MeanFitAt(frame, models, x, y);
    const Sample& sample = frame.At(x, y);
    for (size_t c = 0; c < 3; ++c) {
      const float mean = 0.5f * (fit[c] + fit[3 + c]);
      fits.corrections[c].At(x, y) = mean - fit[6 + c];
      fits.corrections[3 + c].At(x, y) = mean - sample.row[6 + c];
    }
    const Errors errors = ErrorsOf(sample, fit, pixels.is_level.At(x, y) > 0);
    fits.errors[0].At(x, y) = errors.kept;
    fits.errors[1].At(x, y) = errors.mended;
    fits.errors[2].At(x, y) = errors.anew;
    fits.errors[3].At(x, y) = errors.variance;
    fits.is_fitted.At(x, y) = 1;
  });
  return fits;
}

}  // namespace

void RegressEdges(const LayeredImage& film, const LayeredImage* edges, const Planes& change, TaskPool* pool,
                  std::array<Plane, 3>* picture) {
  const float unit = MeanMagnitude(film.GetColor(layers::kNoisy), pool);
  if (!(unit > 0)) return;
  const SeenSurface seen = SeenSurfaceOf(film, pool);
  const MixedPixels pixels(film, edges);
  const Fits fits = FitAll(Source(film, seen, change, *picture, unit), pixels, pool);
  const Planes means = BoxMeans(fits.errors, fits.is_fitted.view(), kTrustRadius, pool);
  const ConstFloatView n_a = film.Get(layers::kSamplesA);
  const ConstFloatView n_b = film.Get(layers::kSamplesB);
  ForEachBand(pool, film.height(), [&](int, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      for (int x = 0; x < film.width(); ++x) {
        if (fits.is_fitted.At(x, y) == 0) continue;
        const Errors errors = {means[0].At(x, y), means[1].At(x, y), means[2].At(x, y), means[3].At(x, y)};
        const Shares shares = SharesOf(errors, n_a.At(x, y) + n_b.At(x, y), pixels.is_level.At(x, y) > 0);
        for (size_t c = 0; c < 3; ++c) {
          (*picture)[c].At(x, y) += unit * (shares.mended * fits.corrections[c].At(x, y) +
                                            shares.anew * fits.corrections[3 + c].At(x, y));
        }
      }
    }
  });
}

}  // namespace lumifold::filter
