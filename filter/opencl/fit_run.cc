#include "filter/opencl/fit_run.h"

#include <algorithm>
#include <cstdint>
#include <vector>

namespace lumifold::filter {
namespace {

using Buffer = KernelRun::Buffer;

/// Sizes in floats.
struct FitSizes {
  explicit FitSizes(const FitCall& call)
      : samples(call.samples.size()),
        firsts(call.firsts.size()),
        of_samples(call.Count()),
        targets(call.targets.size()),
        values(targets * static_cast<uint64_t>(call.shape.signals)),
        model(static_cast<uint64_t>(call.shape.terms) * static_cast<uint64_t>(call.shape.signals)),
        sums(static_cast<uint64_t>(call.shape.terms) * static_cast<uint64_t>(call.shape.Row() + 2)) {
    for (const int32_t target : call.targets) centres += call.IsCentre(target) ? 1 : 0;
  }

  uint64_t samples, firsts, of_samples, targets, values;
  uint64_t model, sums;  // of each model
  uint64_t centres = 0;
};

/// With so many models at a time.
DeviceMemory NeedOf(const FitSizes& sizes, uint64_t models) {
  DeviceMemory need = {0, 0};
  for (const uint64_t floats :
       {sizes.samples, sizes.firsts, sizes.of_samples, sizes.targets, sizes.centres,
        sizes.centres * sizes.model, models * sizes.sums, models, sizes.values, sizes.targets,
        /*that lack a model*/ sizes.targets, sizes.targets, models * sizes.model}) {
    need.whole += floats * sizeof(float);
    need.largest = std::max(need.largest, floats * sizeof(float));
  }
  return need;
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
  FitRun(const FitCall& call, const DeviceMemory& memory, KernelRun* run)
      : call_(call),
        run_(*run),
        sizes_(call),
        window_{call.width, call.height, call.radius, call.falloff},
        most_(ModelsIn(memory, sizes_)) {}

  absl::StatusOr<FitResult> Run() {
    firsts_ = Upload(call_.firsts);
    samples_ = Upload(call_.samples);
    targets_ = Upload(call_.targets);
    sums_ = Floats(most_ * sizes_.sums);
    weights_ = Floats(most_);
    FitCentres();
    values_ = Floats(sizes_.values);
    totals_ = Floats(sizes_.targets);
    run_.Run(
        "FitValues", sizes_.targets,
        {window_, Int(sizes_.targets), targets_, firsts_, samples_, model_of_, models_, values_, totals_});
    if (absl::Status status = run_.Finish(); !status.ok()) return status;
    FitResult result = {std::vector<float>(sizes_.values), std::vector<float>(sizes_.targets)};
    if (absl::Status status = Read(totals_, &result.totals); !status.ok()) return status;
    if (FitLacking(result.totals)) {
      if (absl::Status status = run_.Finish(); !status.ok()) return status;
      if (absl::Status status = Read(totals_, &result.totals); !status.ok()) return status;
    }
    if (absl::Status status = Read(values_, &result.values); !status.ok()) return status;
    return result;
  }

 private:
  static int32_t Int(uint64_t count) { return static_cast<int32_t>(count); }
  Buffer Floats(uint64_t count) { return run_.Allocate(count * sizeof(float)); }
  template <typename T>
  Buffer Upload(absl::Span<const T> values) {
    const Buffer buffer = run_.Allocate(values.size() * sizeof(T));
    run_.Write(buffer, 0, values.data(), values.size() * sizeof(T));
    return buffer;
  }
  absl::Status Read(Buffer from, std::vector<float>* to) {
    return run_.Read(from, 0, to->size() * sizeof(float), to->data());
  }

  /// The models of some centres, from the model `to` on.
  void Fit(uint64_t count, uint64_t from, Buffer centres, uint64_t to, Buffer models) {
    run_.Run("FitSums", count * static_cast<uint64_t>(call_.shape.terms),
             {window_, Int(count), Int(from), centres, firsts_, samples_, sums_});
    run_.Run("FitModels", count, {Int(count), Int(to), call_.slope, sums_, models, weights_});
  }

  void FitCentres() {
    std::vector<int32_t> centres, model_of(call_.Count(), -1);
    for (const int32_t target : call_.targets) {
      if (!call_.IsCentre(target)) continue;
      model_of[static_cast<size_t>(target)] = Int(centres.size());
      centres.push_back(target);
    }
    model_of_ = Upload(absl::MakeConstSpan(model_of));
    models_ = Floats(sizes_.centres * sizes_.model);
    const Buffer all = Upload(absl::MakeConstSpan(centres));
    for (uint64_t first = 0; first < sizes_.centres; first += most_)
      Fit(std::min(most_, sizes_.centres - first), first, all, first, models_);
    run_.Release(all);
  }

  /// Gives targets with too little weight of models around them one of their own. False: there are none.
  bool FitLacking(const std::vector<float>& totals) {
    std::vector<int32_t> samples, numbers;
    for (size_t i = 0; i < totals.size(); ++i) {
      if (!(totals[i] < kMinModelWeight) || call_.IsCentre(call_.targets[i])) continue;
      samples.push_back(call_.targets[i]);
      numbers.push_back(Int(i));
    }
    run_.Release(model_of_);
    if (samples.empty()) return false;
    const Buffer own = Floats(std::min<uint64_t>(most_, samples.size()) * sizes_.model);
    const Buffer centres = Upload(absl::MakeConstSpan(samples));
    const Buffer lacking = Upload(absl::MakeConstSpan(numbers));
    for (uint64_t first = 0; first < samples.size(); first += most_) {
      const uint64_t count = std::min<uint64_t>(most_, samples.size() - first);
      Fit(count, first, centres, 0, own);
      run_.Run("FitOwn", count,
               {Int(count), Int(first), lacking, targets_, samples_, own, weights_, values_, totals_});
    }
    return true;
  }

  const FitCall& call_;
  KernelRun& run_;
  const FitSizes sizes_;
  const FitWindow window_;
  const uint64_t most_;  // models at a time
  Buffer firsts_ = {}, samples_ = {}, targets_ = {}, model_of_ = {}, models_ = {}, sums_ = {}, weights_ = {},
         values_ = {}, totals_ = {};
};

}  // namespace

DeviceMemory LeastMemory(const FitCall& call) { return NeedOf(FitSizes(call), 1); }

DeviceMemory TakenMemory(const FitCall& call, const DeviceMemory& memory) {
  const FitSizes sizes(call);
  return NeedOf(sizes, ModelsIn(memory, sizes));
}

absl::StatusOr<FitResult> RunFit(const FitCall& call, const DeviceMemory& memory, KernelRun* run) {
  run->Use(call.shape);
  return FitRun(call, memory, run).Run();
}

}  // namespace lumifold::filter
