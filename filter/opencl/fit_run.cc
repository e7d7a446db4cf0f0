#include "filter/opencl/fit_run.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <vector>

namespace lumifold::filter {
namespace {

using Buffer = KernelRun::Buffer;

/// Sizes in floats.
struct FitSizes {
  FitSizes(const FitShape& shape, absl::Span<const int32_t> of_firsts, absl::Span<const int32_t> of_targets,
           uint64_t of_centres)
      : firsts(of_firsts.size()),
        of_samples(static_cast<uint64_t>(of_firsts.back())),
        samples(of_samples * static_cast<uint64_t>(shape.Sample())),
        targets(of_targets.size()),
        values(targets * static_cast<uint64_t>(shape.signals)),
        model(static_cast<uint64_t>(shape.terms) * static_cast<uint64_t>(shape.signals)),
        sums(static_cast<uint64_t>(shape.terms) * static_cast<uint64_t>(shape.Row() + 2)),
        centres(of_centres) {}
  explicit FitSizes(const FitOnDevice& fit)
      : FitSizes(fit.shape, fit.firsts, fit.targets, fit.centres.size()) {}

  uint64_t firsts, of_samples, samples, targets, values;
  uint64_t model, sums;  // of each model
  uint64_t centres;
};

/// With so many models at a time.
DeviceMemory NeedOf(const FitSizes& sizes, uint64_t models) {
  return Together({sizes.samples, sizes.firsts, sizes.of_samples, sizes.targets, sizes.centres,
                   sizes.centres * sizes.model, models * sizes.sums, models, sizes.values, sizes.targets,
                   /*that lack a model*/ sizes.targets, sizes.targets, models * sizes.model});
}

/// The most models at a time, of all that there may be.
uint64_t ModelsIn(const DeviceMemory& memory, const FitSizes& sizes) {
  constexpr uint64_t kEnough = 1 << 16;  // keep any device busy
  uint64_t most = std::clamp<uint64_t>(sizes.targets, 1, kEnough);
  while (most > 1 && !memory.Holds(NeedOf(sizes, most))) most = (most + 1) / 2;
  return most;
}

class FitRun {
 public:
  FitRun(const FitOnDevice& fit, const DeviceMemory& memory, KernelRun* run)
      : fit_(fit), run_(*run), sizes_(fit), most_(ModelsIn(memory, sizes_)) {}

  absl::StatusOr<FittedOnDevice> Run() {
    firsts_ = run_.Upload(fit_.firsts);
    targets_ = run_.Upload(fit_.targets);
    sums_ = run_.Floats(most_ * sizes_.sums);
    weights_ = run_.Floats(most_);
    FitCentres();
    values_ = run_.Floats(sizes_.values);
    totals_ = run_.Floats(sizes_.targets);
    run_.Run("FitValues", sizes_.targets,
             {fit_.window, Int(sizes_.targets), targets_, firsts_, fit_.samples, model_of_, models_, values_,
              totals_});
    if (absl::Status status = run_.Finish(); !status.ok()) return status;
    std::vector<float> totals(sizes_.targets);
    absl::Status status = run_.Read(totals_, 0, totals.size() * sizeof(float), totals.data());
    if (!status.ok()) return status;
    FitLacking(totals);
    if (status = run_.Finish(); !status.ok()) return status;
    return FittedOnDevice{targets_, values_, totals_};
  }

 private:
  /// The models of some centres, from the model `to` on.
  void Fit(uint64_t count, uint64_t from, Buffer centres, uint64_t to, Buffer models) {
    run_.Run("FitSums", count * static_cast<uint64_t>(fit_.shape.terms),
             {fit_.window, Int(count), Int(from), centres, firsts_, fit_.samples, sums_});
    run_.Run("FitModels", count, {Int(count), Int(to), fit_.slope, sums_, models, weights_});
  }

  void FitCentres() {
    std::vector<int32_t> model_of(sizes_.of_samples, -1);
    for (size_t i = 0; i < fit_.centres.size(); ++i) model_of[static_cast<size_t>(fit_.centres[i])] = Int(i);
    model_of_ = run_.Upload(model_of);
    models_ = run_.Floats(sizes_.centres * sizes_.model);
    const Buffer all = run_.Upload(fit_.centres);
    for (uint64_t first = 0; first < sizes_.centres; first += most_)
      Fit(std::min(most_, sizes_.centres - first), first, all, first, models_);
    run_.Release(all);
  }

  /// Gives targets with too little weight of models around them one of their own.
  void FitLacking(const std::vector<float>& totals) {
    std::vector<int32_t> samples, numbers;
    for (size_t i = 0; i < totals.size(); ++i) {
      const int32_t target = fit_.targets[i];
      if (!(totals[i] < kMinModelWeight) ||
          std::binary_search(fit_.centres.begin(), fit_.centres.end(), target))
        continue;
      samples.push_back(target);
      numbers.push_back(Int(i));
    }
    run_.Release(model_of_);
    if (samples.empty()) return;
    const Buffer own = run_.Floats(std::min<uint64_t>(most_, samples.size()) * sizes_.model);
    const Buffer centres = run_.Upload(samples);
    const Buffer lacking = run_.Upload(numbers);
    for (uint64_t first = 0; first < samples.size(); first += most_) {
      const uint64_t count = std::min<uint64_t>(most_, samples.size() - first);
      Fit(count, first, centres, 0, own);
      run_.Run("FitOwn", count,
               {Int(count), Int(first), lacking, targets_, fit_.samples, own, weights_, values_, totals_});
    }
  }

  const FitOnDevice& fit_;
  KernelRun& run_;
  const FitSizes sizes_;
  const uint64_t most_;  // models at a time
  Buffer firsts_ = {}, targets_ = {}, model_of_ = {}, models_ = {}, sums_ = {}, weights_ = {}, values_ = {},
         totals_ = {};
};

/// The call without samples.
FitOnDevice FitOf(const FitCall& call) {
  FitOnDevice fit = {.shape = call.shape,
                     .window = {call.width, call.height, call.radius, call.falloff},
                     .slope = call.slope,
                     .firsts = call.firsts,
                     .targets = call.targets,
                     .centres = {}};
  std::copy_if(call.targets.begin(), call.targets.end(), std::back_inserter(fit.centres),
               [&](int32_t target) { return call.IsCentre(target); });
  return fit;
}

}  // namespace

DeviceMemory LeastMemory(const FitOnDevice& fit, uint64_t centres) {
  return NeedOf(FitSizes(fit.shape, fit.firsts, fit.targets, centres), 1);
}

absl::StatusOr<FittedOnDevice> RunDeviceFit(const FitOnDevice& fit, const DeviceMemory& memory,
                                            KernelRun* run) {
  run->Use(fit.shape);
  return FitRun(fit, memory, run).Run();
}

DeviceMemory LeastMemory(const FitCall& call) { return NeedOf(FitSizes(FitOf(call)), 1); }

DeviceMemory TakenMemory(const FitCall& call, const DeviceMemory& memory) {
  const FitSizes sizes(FitOf(call));
  return NeedOf(sizes, ModelsIn(memory, sizes));
}

absl::StatusOr<FitResult> RunFit(const FitCall& call, const DeviceMemory& memory, KernelRun* run) {
  FitOnDevice fit = FitOf(call);
  fit.samples = run->Upload(call.samples);
  const absl::StatusOr<FittedOnDevice> fitted = RunDeviceFit(fit, memory, run);
  if (!fitted.ok()) return fitted.status();
  FitResult result = {std::vector<float>(call.targets.size() * static_cast<size_t>(call.shape.signals)),
                      std::vector<float>(call.targets.size())};
  absl::Status status =
      run->Read(fitted->values, 0, result.values.size() * sizeof(float), result.values.data());
  if (!status.ok()) return status;
  status = run->Read(fitted->totals, 0, result.totals.size() * sizeof(float), result.totals.data());
  if (!status.ok()) return status;
  return result;
}

}  // namespace lumifold::filter
