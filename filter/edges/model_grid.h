#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "filter/edges/linear_fit.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/image/rect.h"
#include "filter/kernels/fit_kernels.h"
#include "filter/manifold/filter_device.h"
#include "filter/manifold/fit_layout.h"

namespace lumifold::filter {

/// Samples of pixels, any number of each, and local linear models fitted to them. Samples in a window are
/// weighted by their distance in the picture and by their likeness. Models are fitted at every third pixel of
/// every third row, and each sample takes the weighted mean of those around it.
/// Threads: identical for any pool.
/// Source:  the collaborative mean over fits of Bitterli et al. 2016.
template <size_t kTerms, size_t kSignals, size_t kTraits>
class ModelGrid {
 private:
  static constexpr size_t kLanes = 4;
  static constexpr size_t kPaddedTraits = (kTraits + kLanes - 1) / kLanes * kLanes;

 public:
  struct Sample {
    FitSample<kTerms, kSignals> fit;
    std::array<float, kPaddedTraits> traits =
        {};            // over their sigmas; samples are alike where these are near
    float weight = 0;  // in fits; 0 where a half is missing or unusable
    float x = 0;       // px, whole
    float y = 0;
  };

  /// Samples of the pixels within a window of those with `fitted` > 0. Source: size_t Count(x, y) const, and
  /// void Read(x, y, Sample* samples) const, which fills as many, but for x and y.
  template <typename Source>
  ModelGrid(const Source& source, const Plane& fitted, const RegressionParams& params, TaskPool* pool)
      : params_(params), bounds_{0, 0, fitted.width(), fitted.height()}, radius_(WindowRadius(params)) {
    FitLayout layout =
        MakeFitLayout(fitted.view(), radius_, [&](int x, int y) { return source.Count(x, y); });
    first_ = std::move(layout.firsts);
    samples_.resize(static_cast<size_t>(first_.back()));
    ForEachPixel(pool, bounds_.width(), bounds_.height(), [&](int x, int y) {
      if (FirstOf(x, y) == EndOf(x, y)) return;
      source.Read(x, y, &samples_[FirstOf(x, y)]);
      for (size_t i = FirstOf(x, y); i < EndOf(x, y); ++i) {
        samples_[i].x = static_cast<float>(x);
        samples_[i].y = static_cast<float>(y);
      }
    });
    Fit(layout.targets, pool);
  }

  /// Index of the first sample of a pixel, and one after the last.
  size_t FirstOf(int x, int y) const { return static_cast<size_t>(first_[IndexOf(x, y)]); }
  size_t EndOf(int x, int y) const { return static_cast<size_t>(first_[IndexOf(x, y) + 1]); }

  const Sample& At(size_t sample) const { return samples_[sample]; }

  /// The signals at a sample of a fitted pixel; none where nothing is like it.
  std::optional<std::array<float, kSignals>> ValueAt(size_t sample) const {
    const auto target = static_cast<size_t>(target_of_[sample]);
    if (!(result_.totals[target] > 0)) return std::nullopt;
    std::array<float, kSignals> value;
    for (size_t s = 0; s < kSignals; ++s)
      value[s] = result_.values[target * kSignals + s] / result_.totals[target];
    return value;
  }

 private:
  using Model = LinearModel<kTerms, kSignals>;
  static constexpr FitShape kShape = {kTerms, kSignals, kPaddedTraits};
  static_assert(sizeof(Sample) == static_cast<size_t>(kShape.Sample()) * sizeof(float));

  size_t IndexOf(int x, int y) const {
    return static_cast<size_t>(y) * static_cast<size_t>(bounds_.width()) + static_cast<size_t>(x);
  }

  float Falloff() const { return FalloffOf(params_); }

  /// On the device of the pool, if it can.
  void Fit(const std::vector<int32_t>& targets, TaskPool* pool) {
    target_of_.assign(samples_.size(), -1);
    for (size_t t = 0; t < targets.size(); ++t)
      target_of_[static_cast<size_t>(targets[t])] = static_cast<int32_t>(t);
    if (targets.empty()) return;
    const FitCall call = {
        kShape,           bounds_.width(),
        bounds_.height(), radius_,
        Falloff(),        params_.slope,
        first_,           {&samples_[0].fit.row[0], samples_.size() * static_cast<size_t>(kShape.Sample())},
        targets};
    FilterDevice* const device = DeviceOf(pool);
    std::optional<FitResult> result = device != nullptr ? device->Fit(call) : std::nullopt;
    if (!result.has_value()) result = FitHere(call, pool);
    result_ = *std::move(result);
  }

  FitResult FitHere(const FitCall& call, TaskPool* pool) {
    ListNumbers(pool);
    std::vector<size_t> centres;
    model_of_.assign(samples_.size(), -1);
    for (const int32_t target : call.targets) {
      if (!call.IsCentre(target)) continue;
      model_of_[static_cast<size_t>(target)] = static_cast<int32_t>(centres.size());
      centres.push_back(static_cast<size_t>(target));
    }
    models_.resize(centres.size());
    ForEachOf(centres.size(), pool, [&](size_t m) {
      models_[m] = *FitAt(centres[m]);  // the centre itself counts
    });
    FitResult result = {std::vector<float>(call.targets.size() * kSignals),
                        std::vector<float>(call.targets.size())};
    ForEachOf(call.targets.size(), pool, [&](size_t t) {
      result.totals[t] = SumModelsAt(static_cast<size_t>(call.targets[t]), &result.values[t * kSignals]);
    });
    return result;
  }

  /// What samples are compared by, number by number: a vector has several samples.
  void ListNumbers(TaskPool* pool) {
    numbers_.resize((kPaddedTraits + 2) * samples_.size() + kLikePadding);
    ForEachOf(samples_.size(), pool, [&](size_t i) {
      float* to = &numbers_[i];
      for (const float trait : samples_[i].traits) *std::exchange(to, to + samples_.size()) = trait;
      to[0] = samples_[i].x;
      to[samples_.size()] = samples_[i].y;
    });
  }

  template <typename Body>
  static void ForEachOf(size_t count, TaskPool* pool, const Body& body) {
    constexpr size_t kPerTask = 256;
    ParallelFor(pool, static_cast<int64_t>((count + kPerTask - 1) / kPerTask), [&](int64_t task) {
      const size_t begin = static_cast<size_t>(task) * kPerTask;
      for (size_t i = begin; i < std::min(begin + kPerTask, count); ++i) body(i);
    });
  }

  /// Sums the signals of the models around a sample. Returns their weight.
  float SumModelsAt(size_t sample, float* to) const {
    const Sample& at = samples_[sample];
    std::array<float, kSignals> sum = {};
    float total = 0;
    const auto add = [&](const Model& model, const Sample& centre, float weight) {
      total += weight;
      for (size_t i = 0; i < kTerms; ++i) {
        const float term =
            i == 0 ? weight : weight * (at.fit.row[kSignals + i] - centre.fit.row[kSignals + i]);
        for (size_t s = 0; s < kSignals; ++s) sum[s] += term * model[i * kSignals + s];
      }
    };
    const auto add_model_of = [&](size_t i, float weight) {
      if (model_of_[i] < 0) return;
      add(models_[static_cast<size_t>(model_of_[i])], samples_[i], weight);
    };
    const Rect window = WindowOf(at);
    for (int y = FirstModelFrom(window.y0); y < window.y1; y += kFitStep) {
      ForEachLike(sample, FirstOf(window.x0, y), EndOf(window.x1 - 1, y), add_model_of);
    }
    if (model_of_[sample] < 0 && total < kMinModelWeight) {
      if (const std::optional<Model> own = FitAt(sample); own.has_value())
        add(*own, at, kMinModelWeight - total);
    }
    std::copy(sum.begin(), sum.end(), to);
    return total;
  }

  std::optional<Model> FitAt(size_t sample) const {
    const Sample& centre = samples_[sample];
    LinearFit<kTerms, kSignals> fit(params_.slope);
    const auto add = [&](size_t i, float weight) {
      if (samples_[i].weight > 0) fit.Add(samples_[i].fit, centre.fit, weight * samples_[i].weight);
    };
    const Rect window = WindowOf(centre);
    for (int y = window.y0; y < window.y1; ++y) {
      ForEachLike(sample, FirstOf(window.x0, y), EndOf(window.x1 - 1, y), add);
    }
    if (fit.IsEmpty()) return std::nullopt;
    return fit.Solve();
  }

  Rect WindowOf(const Sample& centre) const {
    const int x = static_cast<int>(centre.x), y = static_cast<int>(centre.y);
    return Inflate({x, y, x + 1, y + 1}, radius_, bounds_);
  }

  static int FirstModelFrom(int place) { return (place + kFitStep - 1) / kFitStep * kFitStep; }

  /// Calls body(i, weight) for each of the samples [first, last) that has weight around sample `centre`.
  template <typename Body>
  void ForEachLike(size_t centre, size_t first, size_t last, const Body& body) const {
    std::array<float, kMostLikenesses> weights;
    for (; first < last; first += kMostLikenesses) {
      const size_t count = std::min(last - first, kMostLikenesses);
      LikenessOf(
          {numbers_.data(), samples_.size(), kPaddedTraits, first, count, centre, Falloff(), kMaxFitSquare},
          weights.data());
      for (size_t i = 0; i < count; ++i) {
        if (weights[i] > 0) body(first + i, weights[i]);
      }
    }
  }

  const RegressionParams params_;
  const Rect bounds_;
  const int radius_;
  std::vector<int32_t> first_;  // of each pixel, row by row; one more at the end
  std::vector<Sample> samples_;
  std::vector<float> numbers_;     // LikeArgs::numbers
  std::vector<int32_t> model_of_;  // of each sample; -1: it has none
  std::vector<Model> models_;
  std::vector<int32_t> target_of_;  // of each sample: its number among those of fitted pixels; -1: of others
  FitResult result_;
};

}  // namespace lumifold::filter
