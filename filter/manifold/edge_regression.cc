#include "filter/manifold/edge_regression.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "filter/image/layers.h"
#include "filter/image/level_mask.h"
#include "filter/image/portable_math.h"
#include "filter/manifold/band_pixels.h"
#include "filter/manifold/box_mean.h"
#include "filter/manifold/edge_pixels.h"
#include "filter/manifold/error_weight.h"
#include "filter/manifold/recombine.h"

namespace lumifold::filter {
namespace {

constexpr int kRadius = 3;       // 7x7 window
constexpr int kTrustRadius = 3;  // of the errors' means
constexpr float kSigmaPixels = 2.1f;
constexpr float kSigmaLikeness = 0.5f;  // in units of asinh(F / (kKnee mean))
constexpr float kKnee = 0.2f;
constexpr float kRidge = 1e-2f;  // of the window's weight
/// Of C's variance: what is added to both errors, so that estimates that noise made small or negative decide
/// nothing.
constexpr float kLeastError = 0.15f;
constexpr float kLargestFeature = 10;
constexpr float kLargest = 1e12f;  // of C over its mean: squares of squares must stay finite

constexpr size_t kTerms = 8;     // 1, T, normal, covered part
constexpr size_t kSignals = 6;   // C - F of half A and of half B
constexpr size_t kRowSize = 16;  // both, padded to whole vectors

/// What the regression needs of one pixel.
struct Sample {
  std::array<float, kRowSize> row = {};
  std::array<float, 3> likeness = {};
  float light = 0;         // F, over the mean
  bool is_usable = false;  // both halves known and finite
};

/// Squared errors, summed over the channels, by the halves.
struct Errors {
  float without = 0;   // of F as it is
  float with = 0;      // with the fit
  float variance = 0;  // of C
};

float Bounded(float x) { return std::isfinite(x) ? std::clamp(x, -kLargestFeature, kLargestFeature) : 0.0f; }

/// Reads samples out of a film and its filtered picture; light in units of `unit`.
class Source {
 public:
  Source(const LayeredImage& film, const Planes& change, const std::array<Plane, 3>& picture, float unit)
      : a_(film.GetColor(layers::HalfA(layers::kNoisy))),
        b_(film.GetColor(layers::HalfB(layers::kNoisy))),
        n_a_(film.Get(layers::kSamplesA)),
        n_b_(film.Get(layers::kSamplesB)),
        albedo_(film.GetColor(layers::kAlbedo)),
        normal_{film.Get(layers::kNormalX), film.Get(layers::kNormalY), film.Get(layers::kNormalZ)},
        mask_(film.Get(layers::kMask)),
        change_(ViewOf(change)),
        picture_{picture[0].view(), picture[1].view(), picture[2].view()},
        unit_(unit) {}

  Sample At(int x, int y) const {
    Sample sample;
    sample.is_usable = n_a_.At(x, y) > 0 && n_b_.At(x, y) > 0;
    sample.row[0] = 1;
    sample.row[kTerms - 1] = Bounded(mask_.At(x, y));
    for (size_t c = 0; c < 3; ++c) {
      sample.row[1 + c] = Bounded(albedo_[c].At(x, y));
      sample.row[4 + c] = Bounded(normal_[c].At(x, y));
      const float f = picture_[c].At(x, y);
      const float a = (a_[c].At(x, y) + change_[c].At(x, y) - f) / unit_;
      const float b = (b_[c].At(x, y) + change_[c].At(x, y) - f) / unit_;
      sample.is_usable = sample.is_usable && std::abs(a) < kLargest && std::abs(b) < kLargest;
      sample.row[kTerms + c] = a;
      sample.row[kTerms + 3 + c] = b;
      sample.light += std::abs(f / unit_) / 3;
      sample.likeness[c] = Asinh(f / unit_ * (1.0f / kKnee));
    }
    return sample;
  }

 private:
  ConstColorView a_, b_;
  ConstFloatView n_a_, n_b_;
  ConstColorView albedo_, normal_;
  ConstFloatView mask_;
  ConstColorView change_, picture_;
  float unit_;
};

/// Weighted least squares over samples whose terms are counted from those of the pixel itself: what the fit
/// says of that pixel is its constant.
class Fit {
 public:
  void Add(const Sample& sample, const Sample& centre, float weight) {
    std::array<float, kRowSize> row = sample.row;
    for (size_t i = 1; i < kTerms; ++i) row[i] -= centre.row[i];
    for (size_t i = 0; i < kTerms; ++i) {
      const float by = weight * row[i];
      for (size_t j = 0; j < kRowSize; ++j) sums_[i][j] += by * row[j];
    }
  }

  /// The constant of each signal. Consumes the sums.
  std::array<float, kSignals> Solve() {
    for (size_t i = 1; i < kTerms; ++i) sums_[i][i] += kRidge * sums_[0][0];
    // Elimination from the last term up to the constant, whose row then stands alone. It needs no pivots: the
    // ridge keeps the matrix positive definite.
    for (size_t k = kTerms - 1; k > 0; --k) {
      for (size_t i = 0; i < k; ++i) {
        const float by = sums_[i][k] / sums_[k][k];
        for (size_t j = 0; j < kRowSize; ++j) sums_[i][j] -= by * sums_[k][j];
      }
    }
    std::array<float, kSignals> constants;
    for (size_t s = 0; s < kSignals; ++s) constants[s] = sums_[0][kTerms + s] / sums_[0][0];
    return constants;
  }

 private:
  std::array<std::array<float, kRowSize>, kTerms> sums_ = {};
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

/// What the pixels about (x, y) that look alike leave there.
std::array<float, kSignals> FitAt(const BandPixels<Sample>& samples, int x, int y) {
  constexpr float kNearness = 1.0f / (2 * kSigmaPixels * kSigmaPixels);
  const Sample& centre = samples.At(x, y);
  const Rect window = samples.WindowAt(x, y);
  Fit fit;
  for (int j = window.y0; j < window.y1; ++j) {
    for (int i = window.x0; i < window.x1; ++i) {
      const Sample& other = samples.At(i, j);
      if (!other.is_usable) continue;
      const auto apart = static_cast<float>((i - x) * (i - x) + (j - y) * (j - y));
      fit.Add(other, centre, Exp(-Unlikeness(centre, other) - kNearness * apart));
    }
  }
  return fit.Solve();
}

/// Half B judges what half A was fitted by, and the reverse.
Errors ErrorsOf(const Sample& sample, const std::array<float, kSignals>& fit) {
  Errors errors;
  const float weight = ErrorWeight(sample.light);
  for (size_t c = 0; c < 3; ++c) {
    const float a = sample.row[kTerms + c];
    const float b = sample.row[kTerms + 3 + c];
    const float off_a = fit[c] - b;
    const float off_b = fit[3 + c] - a;
    const float apart = fit[c] - fit[3 + c];
    const float noise = (a - b) * (a - b);
    errors.without += weight * a * b;
    errors.with += weight * ((off_a * off_a + off_b * off_b - noise) / 2 - apart * apart / 4);
    errors.variance += weight * noise / 4;
  }
  return errors;
}

/// How far the fit is followed: by the squares of the inverse errors.
float ShareOfFit(const Errors& errors) {
  const float least = kLeastError * errors.variance;
  const float without = least + std::max(errors.without, 0.0f);
  const float with = least + std::max(errors.with, 0.0f);
  if (!(without + with > 0)) return 0;
  const float relative = without / (without + with);
  const float rest = 1.0f - relative;
  return relative * relative / (relative * relative + rest * rest);
}

/// 1 at pixels of the edge set and at those that show a level.
Plane MixedPixels(const LayeredImage& film, const LayeredImage* edges) {
  Plane mixed = LevelMask(film);
  ForEachEdgePixel(edges, film.bounds(), [&](int, int x, int y) { mixed.At(x, y) = 1; });
  return mixed;
}

/// The fits of all pixels that are fitted, in the source's units.
struct Fits {
  Plane is_fitted;     // 1 or 0
  Planes corrections;  // 3
  Planes errors;       // without, with, variance
};

void FitBand(const BandPixels<Sample>& samples, int y0, int y1, Fits* fits) {
  for (int y = y0; y < y1; ++y) {
    for (int x = 0; x < fits->is_fitted.width(); ++x) {
      float& is_fitted = fits->is_fitted.At(x, y);
      if (!samples.At(x, y).is_usable) is_fitted = 0;
      if (is_fitted == 0) continue;
      const std::array<float, kSignals> fit = FitAt(samples, x, y);
      for (size_t c = 0; c < 3; ++c) fits->corrections[c].At(x, y) = 0.5f * (fit[c] + fit[3 + c]);
      const Errors errors = ErrorsOf(samples.At(x, y), fit);
      fits->errors[0].At(x, y) = errors.without;
      fits->errors[1].At(x, y) = errors.with;
      fits->errors[2].At(x, y) = errors.variance;
    }
  }
}

}  // namespace

void RegressEdges(const LayeredImage& film, const LayeredImage* edges, const Planes& change, TaskPool* pool,
                  std::array<Plane, 3>* picture) {
  const float unit = MeanMagnitude(film.GetColor(layers::kNoisy), pool);
  if (!(unit > 0)) return;
  const Source source(film, change, *picture, unit);
  const int width = film.width();
  const int height = film.height();
  Fits fits{MixedPixels(film, edges), MakePlanes(3, width, height), MakePlanes(3, width, height)};
  ForEachBand(pool, height, [&](int, int y0, int y1) {
    const BandPixels<Sample> samples(film.bounds(), y0, y1, kRadius,
                                     [&](int x, int y) { return source.At(x, y); });
    FitBand(samples, y0, y1, &fits);
  });
  const Planes means = BoxMeans(fits.errors, fits.is_fitted.view(), kTrustRadius, pool);
  ForEachBand(pool, height, [&](int, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      for (int x = 0; x < width; ++x) {
        if (fits.is_fitted.At(x, y) == 0) continue;
        const float share = ShareOfFit({means[0].At(x, y), means[1].At(x, y), means[2].At(x, y)});
        for (size_t c = 0; c < 3; ++c) (*picture)[c].At(x, y) += share * fits.corrections[c].At(x, y) * unit;
      }
    }
  });
}

}  // namespace lumifold::filter
