#include "tests/unit/filter/manifold_oracle.h"

#include <bit>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <functional>
#include <map>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "filter/image/check.h"
#include "filter/kernels/kernel_constants.h"
#include "filter/manifold/manifold_constants.h"
#include "filter/opencl/fit_run.h"
#include "filter/opencl/kernel_run.h"
#include "filter/opencl/layer_run.h"
#include "filter/opencl/manifold_run.h"

namespace lumifold::filter {
namespace {

namespace kernels {

// The language of the kernels, and what their host defines.
using std::copysign;
using std::fabs;
using std::sqrt;
size_t work_item = 0;
size_t get_global_id(int) { return work_item; }
int as_int(float x) { return std::bit_cast<int>(x); }
float as_float(int x) { return std::bit_cast<float>(x); }
// NOLINTBEGIN(bugprone-reserved-identifier,clang-diagnostic-reserved-macro-identifier): words of OpenCL
#define __kernel
#define __global
// NOLINTEND(bugprone-reserved-identifier,clang-diagnostic-reserved-macro-identifier)
#include "filter/opencl/shared.cl"
int FEATURES = 1;
int CHANNELS = 1;
int FITS = 0;
int STEP = 1;
constexpr int MOST_FEATURES = 32;
constexpr int MOST_PLANES = 16;
constexpr int MOST_STEP = 64;
#include "filter/opencl/manifold.cl"
using ulong = uint64_t;
double as_double(ulong bits) { return std::bit_cast<double>(bits); }
constexpr ulong kLeastSpread = std::bit_cast<ulong>(filter::kLeastSpread);
#define DOUBLES 1
#include "filter/opencl/reals.cl"

#include "filter/opencl/choice.cl"
#include "filter/opencl/covariance.cl"
#include "filter/opencl/energy.cl"
#include "filter/opencl/layer.cl"
#include "filter/opencl/projection.cl"
int FIT_TERMS = 1;
int FIT_SIGNALS = 1;
int FIT_TRAITS = 4;
constexpr int MOST_FIT_ROW = 24;
#include "filter/opencl/fit.cl"
#include "filter/opencl/light.cl"

}  // namespace kernels

class RunInCpp final : public KernelRun {
 public:
  explicit RunInCpp(const DeviceMemory& memory = {}) : memory_(memory) {}

  void Use(const ProgramOptions& options) override {
    std::visit([](const auto& of) { Define(of); }, options);
  }

  Buffer Allocate(size_t bytes) override {
    allocated_ += bytes;
    LUMIFOLD_CHECK(memory_.Holds({allocated_, bytes}));
    buffers_.emplace_back(bytes, std::byte{0xff});  // NaN until it is written
    return static_cast<Buffer>(buffers_.size() - 1);
  }
  void Release(Buffer buffer) override {
    allocated_ -= buffers_[static_cast<size_t>(buffer)].size();
    buffers_[static_cast<size_t>(buffer)] = {};
  }
  void Write(Buffer to, size_t offset, const void* from, size_t bytes) override {
    if (bytes > 0) std::memcpy(MemoryOf(to) + offset, from, bytes);
  }
  void Copy(Buffer from, size_t from_offset, Buffer to, size_t to_offset, size_t bytes) override {
    if (bytes > 0) std::memcpy(MemoryOf(to) + to_offset, MemoryOf(from) + from_offset, bytes);
  }
  void Run(const char* kernel, size_t items, std::initializer_list<Argument> arguments) override;
  absl::Status Finish() override { return absl::OkStatus(); }
  absl::Status Read(Buffer from, size_t offset, size_t bytes, void* to) override {
    if (bytes > 0) std::memcpy(to, MemoryOf(from) + offset, bytes);
    return absl::OkStatus();
  }

 private:
  static void Define(const KernelOptions& options) {
    LUMIFOLD_CHECK(options.features <= kernels::MOST_FEATURES && options.planes() <= kernels::MOST_PLANES);
    kernels::FEATURES = options.features;
    kernels::CHANNELS = options.channels;
    kernels::FITS = options.fits ? 1 : 0;
    kernels::STEP = options.step;
  }
  static void Define(const FitShape& shape) {
    LUMIFOLD_CHECK(shape.Row() <= kernels::MOST_FIT_ROW);
    kernels::FIT_TERMS = shape.terms;
    kernels::FIT_SIGNALS = shape.signals;
    kernels::FIT_TRAITS = shape.traits;
  }
  static void Define(const LayerProgram&) {}

  std::byte* MemoryOf(Buffer buffer) { return buffers_[static_cast<size_t>(buffer)].data(); }

  template <typename T>
  T ValueOf(const Argument& argument) {
    if constexpr (std::is_pointer_v<T>)
      return reinterpret_cast<T>(MemoryOf(std::get<Buffer>(argument)));
    else if constexpr (std::is_same_v<T, kernels::Grid>)
      return std::bit_cast<kernels::Grid>(std::get<Grid>(argument));
    else if constexpr (std::is_same_v<T, kernels::FitWindow>)
      return std::bit_cast<kernels::FitWindow>(std::get<FitWindow>(argument));
    else
      return std::get<T>(argument);
  }
  template <typename... T, size_t... i>
  void Call(void (*kernel)(T...), const Argument* arguments, std::index_sequence<i...>) {
    kernel(ValueOf<T>(arguments[i])...);
  }
  template <typename... T>
  void CallEach(void (*kernel)(T...), size_t items, std::initializer_list<Argument> arguments) {
    LUMIFOLD_CHECK(arguments.size() == sizeof...(T));
    for (size_t item = 0; item < items + 3; ++item) {  // those beyond the last do nothing
      kernels::work_item = item;
      Call(kernel, arguments.begin(), std::index_sequence_for<T...>());
    }
  }

  const DeviceMemory memory_;
  uint64_t allocated_ = 0;
  std::vector<std::vector<std::byte>> buffers_;
};

void RunInCpp::Run(const char* kernel, size_t items, std::initializer_list<Argument> arguments) {
  const std::string name = kernel;
  const auto call_if = [&](const char* other, auto function) {
    if (name == other) CallEach(function, items, arguments);
    return name == other;
  };
#define LUMIFOLD_CALL(other) call_if(#other, kernels::other)
  const bool is_known =
      LUMIFOLD_CALL(Clear) || LUMIFOLD_CALL(ShareFeatures) || LUMIFOLD_CALL(Replace) ||
      LUMIFOLD_CALL(ClusterSums) || LUMIFOLD_CALL(EvenRows) || LUMIFOLD_CALL(EvenColumns) ||
      LUMIFOLD_CALL(Heights) || LUMIFOLD_CALL(RowCovariance) || LUMIFOLD_CALL(Covariance) ||
      LUMIFOLD_CALL(Axis) || LUMIFOLD_CALL(Weigh) || LUMIFOLD_CALL(KeepMass) || LUMIFOLD_CALL(Splat) ||
      LUMIFOLD_CALL(Moments) || LUMIFOLD_CALL(Links) || LUMIFOLD_CALL(GuidedRows) ||
      LUMIFOLD_CALL(GuidedColumns) || LUMIFOLD_CALL(Slice) || LUMIFOLD_CALL(Project) ||
      LUMIFOLD_CALL(Stabilise) || LUMIFOLD_CALL(MeanOfHalves) || LUMIFOLD_CALL(SubtractHalf) ||
      LUMIFOLD_CALL(PatchProducts) || LUMIFOLD_CALL(AddToPixels) || LUMIFOLD_CALL(EnergyFeatures) ||
      LUMIFOLD_CALL(EnergySignals) || LUMIFOLD_CALL(LightAndRemoved) || LUMIFOLD_CALL(SharedEnergy) ||
      LUMIFOLD_CALL(RowTotals) || LUMIFOLD_CALL(AddRest) || LUMIFOLD_CALL(AddEnergy) ||
      LUMIFOLD_CALL(ShareEnergy) || LUMIFOLD_CALL(ProbeReals) || LUMIFOLD_CALL(FitSums) ||
      LUMIFOLD_CALL(FitModels) || LUMIFOLD_CALL(FitValues) || LUMIFOLD_CALL(FitOwn) ||
      LUMIFOLD_CALL(TakeFiltered) || LUMIFOLD_CALL(MeanOfPoints) || LUMIFOLD_CALL(LightOf) ||
      LUMIFOLD_CALL(WeighErrors) || LUMIFOLD_CALL(WeighErrorsOfPoints) || LUMIFOLD_CALL(TermsOfPixels) ||
      LUMIFOLD_CALL(TermsOfPoints) || LUMIFOLD_CALL(TermsOfCells) || LUMIFOLD_CALL(SumRowsOfCells) ||
      LUMIFOLD_CALL(RefineCells) || LUMIFOLD_CALL(ShareOfCells) || LUMIFOLD_CALL(RefinePixels) ||
      LUMIFOLD_CALL(SmoothShare) || LUMIFOLD_CALL(MoveTowards) || LUMIFOLD_CALL(LightSamples) ||
      LUMIFOLD_CALL(TakeFit);
#undef LUMIFOLD_CALL
  LUMIFOLD_CHECK(is_known);
}

class OracleDevice final : public FilterDevice {
 public:
  explicit OracleDevice(bool is_small) : is_small_(is_small) {}

  std::string OtherBits() const override { return ""; }
  std::optional<ManifoldResult> Filter(const ManifoldCall& call) override {
    return FilterOracle(call, is_small_ ? LeastMemory(call) : DeviceMemory{});
  }
  std::optional<FitResult> Fit(const FitCall& call) override {
    const DeviceMemory memory = is_small_ ? LeastMemory(call) : DeviceMemory{};
    RunInCpp run(memory);
    return *RunFit(call, memory, &run);
  }
  std::optional<LayerResult> FilterLayer(const LayerCall& call) override {
    const DeviceMemory memory = is_small_ ? LeastMemory(call) : DeviceMemory{};
    RunInCpp run(memory);
    return *RunLayerCall(call, memory, &run);
  }

 private:
  const bool is_small_;
};

}  // namespace

ManifoldResult ManifoldFilterOracle(const Planes& signals, const Planes& features, ConstFloatView mask,
                                    const ManifoldParams& params, float reach, const SlicePoints* points,
                                    const DeviceMemory& memory) {
  const ManifoldCall call = {ViewsOf(signals), {}, ViewsOf(features), mask, params, reach, points};
  return FilterOracle(call, memory);
}

ManifoldResult FilterOracle(const ManifoldCall& call, const DeviceMemory& memory) {
  RunInCpp run(memory);
  return *RunManifolds(call, memory, &run);
}

std::unique_ptr<TaskPool> PoolWithOracle(bool is_small) {
  return WithDevice(MakeTaskPool(1), std::make_shared<OracleDevice>(is_small));
}

Planes ProjectPatchesOracle(const Planes& color, const PatchBasis& basis) {
  const Grid grid = {
      .width = color[0].width(), .height = color[0].height(), .columns = 0, .rows = 0, .points = 0};
  const size_t row = static_cast<size_t>(grid.width), pixels = row * static_cast<size_t>(grid.height);
  const size_t bytes = pixels * sizeof(float), dimensions = static_cast<size_t>(basis.dimensions);
  RunInCpp run;
  const KernelRun::Buffer colors = run.Allocate(color.size() * bytes);
  const KernelRun::Buffer taps = run.Allocate(basis.kernels.size() * sizeof(float));
  const KernelRun::Buffer result = run.Allocate(dimensions * bytes);
  for (size_t c = 0; c < color.size(); ++c) {
    for (size_t y = 0; y < static_cast<size_t>(grid.height); ++y)
      run.Write(colors, c * bytes + y * row * sizeof(float), color[c].Row(static_cast<int>(y)),
                row * sizeof(float));
  }
  run.Write(taps, 0, basis.kernels.data(), basis.kernels.size() * sizeof(float));
  run.Run(
      "Project", dimensions * pixels,
      {grid, static_cast<int32_t>(color.size()), basis.dimensions, basis.radius, 1.0f, colors, taps, result});
  Planes planes = MakeUninitializedPlanes(dimensions, grid.width, grid.height);
  for (size_t k = 0; k < dimensions; ++k) {
    for (size_t y = 0; y < static_cast<size_t>(grid.height); ++y)
      (void)run.Read(result, k * bytes + y * row * sizeof(float), row * sizeof(float),
                     planes[k].Row(static_cast<int>(y)));
  }
  return planes;
}

}  // namespace lumifold::filter
