#include "tests/charts/methods/samples/random_parameters.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>

#include "filter/image/planes.h"
#include "filter/image/portable_math.h"
#include "tests/charts/methods/samples/mutual_information.h"
#include "tests/charts/methods/samples/neighbourhood.h"

namespace lumifold::charts {
namespace {

using scene::Vec3;

/// A pass: the box that samples are drawn from, and their fraction.
struct Pass {
  int side = 0;      // pixels
  double share = 0;  // of the samples in the box
};
constexpr std::array<Pass, 4> kPasses = {{{55, 0.02}, {35, 0.04}, {17, 0.3}, {7, 0.5}}};

constexpr size_t kColors = Variables::kRandom - Variables::kColor;
constexpr size_t kFeatures = Variables::kCount - Variables::kFeature;
constexpr double kLeastDependency = 1e-10;

/// The weights of colour and features in a neighbourhood, from their dependency on the random numbers: alpha,
/// beta and W_c^r of Sen & Darabi. One alpha serves all channels, since one per channel would shift hues.
struct Importance {
  double color = 0;
  std::array<double, kFeatures> features = {};
  double random = 0;  // W_c^r: dependency of the colour on the random numbers
};

/// The mutual information of the variables of a neighbourhood.
class Dependencies {
 public:
  Dependencies(const MutualInformation& information, bool unbiased)
      : information_(information), unbiased_(unbiased) {}

  /// Sets the samples of later calls.
  void Set(const Neighbourhood& samples) {
    for (size_t v = 0; v < bins_.size(); ++v) {
      SortIntoBins(samples.Standard(v), &bins_[v]);
      varies_[v] =
          std::adjacent_find(bins_[v].begin(), bins_[v].end(), std::not_equal_to<>()) != bins_[v].end();
    }
  }

  /// The sum over variables [first, last) of their mutual information with `variable`.
  double Sum(size_t variable, size_t first, size_t last) const {
    double sum = 0;
    for (size_t v = first; v < last; ++v) {
      if (varies_[variable] && varies_[v]) sum += information_.Of(bins_[variable], bins_[v], unbiased_);
    }
    return sum;
  }

 private:
  const MutualInformation& information_;
  bool unbiased_;
  std::array<std::vector<uint8_t>, Variables::kCount> bins_;
  std::array<bool, Variables::kCount> varies_ = {};
};

Importance ImportanceOf(const Dependencies& dependencies, int pass) {
  const double sharpened = 1 + 0.1 * pass;
  double on_random = 0;
  double on_position = 0;
  double on_features = 0;
  double color_dependency = 0;  // the sum over channels
  std::array<double, kFeatures> color_on_feature = {};
  for (size_t c = Variables::kColor; c < Variables::kColor + kColors; ++c) {
    const double random = dependencies.Sum(c, Variables::kRandom, Variables::kFeature);
    const double position = dependencies.Sum(c, Variables::kPosition, Variables::kColor);
    on_random += random;
    on_position += position;
    color_dependency += random / (random + position + kLeastDependency);
    for (size_t f = 0; f < kFeatures; ++f) {
      const double feature = dependencies.Sum(c, Variables::kFeature + f, Variables::kFeature + f + 1);
      color_on_feature[f] += feature;
      on_features += feature;
    }
  }
  Importance importance;
  importance.random = color_dependency / kColors;
  importance.color = std::max(1 - sharpened * importance.random, 0.0);
  for (size_t f = 0; f < kFeatures; ++f) {
    const size_t variable = Variables::kFeature + f;
    const double random = dependencies.Sum(variable, Variables::kRandom, Variables::kFeature);
    const double position = dependencies.Sum(variable, Variables::kPosition, Variables::kColor);
    const double feature_dependency = random / (random + position + kLeastDependency);
    const double share = color_on_feature[f] / (on_random + on_position + on_features + kLeastDependency);
    importance.features[f] = share * std::max(1 - sharpened * feature_dependency, 0.0);
  }
  return importance;
}

/// Weighted means over a neighbourhood for each of its samples.
class Weights {
 public:
  /// Sets the samples of later calls.
  void Set(const Neighbourhood& samples, const Importance& importance, double variance) {
    count_ = samples.size();
    padded_ = (count_ + kLanes - 1) / kLanes * kLanes;
    used_ = 0;
    const double sharpness = (1 - importance.random) * (1 - importance.random) / (2 * variance);
    for (size_t c = 0; c < kColors; ++c)
      AddVariable(samples.Standard(Variables::kColor + c), sharpness * importance.color);
    for (size_t f = 0; f < kFeatures; ++f)
      AddVariable(samples.Standard(Variables::kFeature + f), sharpness * importance.features[f]);
    for (size_t c = 0; c < 3; ++c) {
      light_[c].assign(padded_, 0.0f);
      for (size_t i = 0; i < count_; ++i) light_[c][i] = samples.colors()[i][static_cast<int>(c)];
    }
    weights_.resize(padded_);
  }

  /// The mean colour with the weights of sample `own`.
  Vec3 MeanFor(size_t own) {
    std::fill(weights_.begin(), weights_.end(), 0.0f);
    for (size_t v = 0; v < used_; ++v) AddSquares(variables_[v][own], variables_[v].data());
    for (size_t i = 0; i < padded_; i += kLanes) {
      for (size_t l = 0; l < kLanes; ++l) weights_[i + l] = Exp(-weights_[i + l]);
    }
    std::fill(weights_.begin() + static_cast<std::ptrdiff_t>(count_), weights_.end(), 0.0f);
    std::array<float, kLanes> total = {};
    std::array<std::array<float, kLanes>, 3> sums = {};
    for (size_t i = 0; i < padded_; i += kLanes) {
      for (size_t l = 0; l < kLanes; ++l) total[l] += weights_[i + l];
      for (size_t c = 0; c < 3; ++c) {
        for (size_t l = 0; l < kLanes; ++l) sums[c][l] += weights_[i + l] * light_[c][i + l];
      }
    }
    const auto sum = [](const std::array<float, kLanes>& lanes) {
      float result = 0;
      for (const float lane : lanes) result += lane;
      return result;
    };
    return Vec3{sum(sums[0]), sum(sums[1]), sum(sums[2])} / sum(total);  // the sample's own weight is 1
  }

 private:
  static constexpr size_t kLanes = 8;  // loops of fixed length vectorise

  void AddVariable(absl::Span<const float> values, double weight) {
    if (weight <= 0) return;
    const float scale = static_cast<float>(std::sqrt(weight));
    std::vector<float>& variable = variables_[used_++];
    variable.assign(padded_, 0.0f);
    for (size_t i = 0; i < count_; ++i) variable[i] = scale * values[i];
  }

  void AddSquares(float own, const float* values) {
    for (size_t i = 0; i < padded_; i += kLanes) {
      float* __restrict sum = weights_.data() + i;
      for (size_t l = 0; l < kLanes; ++l) sum[l] += (values[i + l] - own) * (values[i + l] - own);
    }
  }

  size_t count_ = 0;
  size_t padded_ = 0;
  size_t used_ = 0;  // variables in use
  std::array<std::vector<float>, kColors + kFeatures>
      variables_;  // scaled so that their squares add up to the exponent
  std::array<std::vector<float>, 3> light_;
  std::vector<float> weights_;
};

Vec3 MeanOf(absl::Span<const Vec3> colors) {
  Vec3 sum;
  for (const Vec3 color : colors) sum += color;
  return sum / static_cast<float>(colors.size());
}

/// Replaces the outliers of a pixel, samples more than one standard deviation from the mean, by the mean. The
/// energy that this removes is added to all samples.
void ClampOutliers(absl::Span<Vec3> colors) {
  const Vec3 mean = MeanOf(colors);
  Vec3 variance;
  for (const Vec3 color : colors) variance += (color - mean) * (color - mean);
  variance = variance / static_cast<float>(colors.size());
  for (Vec3& color : colors) {
    const Vec3 square = (color - mean) * (color - mean);
    if (square.x > variance.x || square.y > variance.y || square.z > variance.z) color = mean;
  }
  const Vec3 lost = mean - MeanOf(colors);
  for (Vec3& color : colors) color += lost;
}

/// The settings of a run.
struct Settings {
  double variance = 0;
  double budget = 0;
  bool unbiased = false;
};

/// One pass over pixels, one at a time; memory is reused.
class PixelFilter {
 public:
  PixelFilter(const SampleSet& set, const std::vector<Vec3>& colors, const Settings& settings, int pass,
              const MutualInformation& information)
      : set_(set),
        colors_(colors),
        settings_(settings),
        pass_(pass),
        dependencies_(information, settings.unbiased) {}

  /// Writes the new colours of a pixel's samples.
  void Filter(int x, int y, absl::Span<Vec3> out) {
    const Pass& step = kPasses[static_cast<size_t>(pass_)];
    const double in_box = static_cast<double>(step.side * step.side) * set_.samples_per_pixel;
    samples_.Draw(set_, colors_, x, y, pass_, step.side,
                  static_cast<size_t>(in_box * step.share * settings_.budget));
    dependencies_.Set(samples_);
    weights_.Set(samples_, ImportanceOf(dependencies_, pass_), settings_.variance);
    for (size_t i = 0; i < out.size(); ++i) out[i] = weights_.MeanFor(i);
    ClampOutliers(out);
  }

 private:
  const SampleSet& set_;
  const std::vector<Vec3>& colors_;
  const Settings& settings_;
  int pass_;
  Neighbourhood samples_;
  Dependencies dependencies_;
  Weights weights_;
};

size_t MostSamples(const SampleSet& set, double budget) {
  double most = 0;
  for (const Pass& pass : kPasses) most = std::max(most, pass.side * pass.side * pass.share);
  return static_cast<size_t>(most * budget * set.samples_per_pixel) + set.samples_per_pixel;
}

absl::StatusOr<Picture> FilterByDependency(const SampleSet& set, absl::Span<const float> values,
                                           TaskPool* pool) {
  constexpr double kSamplesOfVariance = 8;  // samples per pixel of the published variance
  const Settings settings = {static_cast<double>(values[0]) * kSamplesOfVariance / set.samples_per_pixel,
                             static_cast<double>(values[1]), values[2] > 0};
  const MutualInformation information(MostSamples(set, settings.budget));
  std::vector<Vec3> colors;
  for (const ChartSample& sample : set.samples) colors.push_back(sample.radiance);
  std::vector<Vec3> filtered(colors.size());
  const auto samples_of = [&](std::vector<Vec3>* all, int x, int y) {
    const size_t pixel = static_cast<size_t>(y) * static_cast<size_t>(set.width) + static_cast<size_t>(x);
    return absl::MakeSpan(*all).subspan(pixel * set.samples_per_pixel, set.samples_per_pixel);
  };
  for (int pass = 0; pass < static_cast<int>(kPasses.size()); ++pass) {
    ParallelFor(pool, set.height, [&](int64_t row) {
      const int y = static_cast<int>(row);
      PixelFilter filter(set, colors, settings, pass, information);
      for (int x = 0; x < set.width; ++x) filter.Filter(x, y, samples_of(&filtered, x, y));
    });
    std::swap(colors, filtered);
  }
  Picture picture = MakePicture(set.width, set.height);
  ForEachPixel(set.width, set.height, [&](int x, int y) {
    const Vec3 mean = MeanOf(samples_of(&colors, x, y));
    for (int c = 0; c < 3; ++c) picture[static_cast<size_t>(c)].At(x, y) = mean[c];
  });
  return picture;
}

}  // namespace

SampleMethod RandomParametersMethod() {
  return {
      .info =
          {.name = "random-parameters",
           .summary = "means of samples, weighted by how much colour depends on position, surface and random "
                      "numbers",
           .source = "Sen & Darabi 2012",
           .parameters =
               {{"variance", "of the weights, at 8 spp", 0.02f, {0.02f, 0.1f, 0.5f, 2}, 1e-4f, 100},
                {"budget", "number of samples compared, over the published number", 1, {1}, 0.01f, 4},
                {"unbias", "1: subtracts the bias of few samples from mutual information", 1, {1}, 0, 1}}},
      .filter = FilterByDependency};
}

}  // namespace lumifold::charts
