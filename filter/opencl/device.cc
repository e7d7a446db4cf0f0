#include "filter/opencl/device.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <functional>
#include <map>
#include <type_traits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "filter/image/mix_bits.h"
#include "filter/kernels/kernel_constants.h"
#include "filter/manifold/layer_call.h"
#include "filter/manifold/manifold_constants.h"
#include "filter/opencl/choice_source.h"
#include "filter/opencl/covariance_source.h"
#include "filter/opencl/energy_source.h"
#include "filter/opencl/fit_source.h"
#include "filter/opencl/layer_source.h"
#include "filter/opencl/light_source.h"
#include "filter/opencl/manifold_source.h"
#include "filter/opencl/opencl_library.h"
#include "filter/opencl/probe_source.h"
#include "filter/opencl/projection_source.h"
#include "filter/opencl/reals_source.h"
#include "filter/opencl/shared_source.h"

namespace lumifold::filter {
namespace {

/// Work-items of a group: a warp of every GPU, or two.
constexpr size_t kGroup = 64;

/// An object of OpenCL that is released at the end.
template <typename T>
using Held = std::unique_ptr<std::remove_pointer_t<T>, cl_int (*)(T)>;

std::string TextOf(const OpenClLibrary& cl, cl_device_id device, cl_device_info what) {
  std::array<char, 1024> text = {};
  cl.clGetDeviceInfo(device, what, text.size() - 1, text.data(), nullptr);
  return text.data();
}
template <typename T>
T NumberOf(const OpenClLibrary& cl, cl_device_id device, cl_device_info what) {
  T value = {};
  cl.clGetDeviceInfo(device, what, sizeof(value), &value, nullptr);
  return value;
}

std::string RefusalOf(const OpenClLibrary& cl, cl_device_id device) {
  if (NumberOf<cl_bool>(cl, device, CL_DEVICE_COMPILER_AVAILABLE) == CL_FALSE) return "it has no compiler";
  if (NumberOf<cl_bool>(cl, device, CL_DEVICE_ENDIAN_LITTLE) == CL_FALSE) return "its numbers are big-endian";
  return "";
}

std::string OtherBitsOf(const OpenClLibrary& cl, cl_device_id device) {
  const auto single = NumberOf<cl_device_fp_config>(cl, device, CL_DEVICE_SINGLE_FP_CONFIG);
  if ((single & CL_FP_CORRECTLY_ROUNDED_DIVIDE_SQRT) == 0)
    return "it does not round quotients and roots correctly";
  if ((single & CL_FP_DENORM) == 0) return "it has no denormal numbers";
  if ((single & CL_FP_ROUND_TO_NEAREST) == 0) return "it does not round to nearest";
  return "";
}

std::vector<cl_device_id> FindDevices(const OpenClLibrary& cl) {
  std::array<cl_platform_id, 16> platforms = {};
  cl_uint platform_count = 0;
  std::vector<cl_device_id> found;
  if (cl.clGetPlatformIDs(platforms.size(), platforms.data(), &platform_count) != CL_SUCCESS) return found;
  for (size_t i = 0; i < std::min<size_t>(platform_count, platforms.size()); ++i) {
    std::array<cl_device_id, 64> devices = {};
    cl_uint count = 0;
    if (cl.clGetDeviceIDs(platforms[i], CL_DEVICE_TYPE_ALL, devices.size(), devices.data(), &count) !=
        CL_SUCCESS)
      continue;
    found.insert(found.end(), devices.begin(), devices.begin() + std::min<size_t>(count, devices.size()));
  }
  return found;
}

/// Without it reals.cl does with integers.
bool HasDoubles(const OpenClLibrary& cl, cl_device_id device) {
  return (NumberOf<cl_device_fp_config>(cl, device, CL_DEVICE_DOUBLE_FP_CONFIG) & CL_FP_DENORM) != 0;
}

/// What the compiler is told of a program.
struct ProgramText {
  std::vector<const char*> sources;
  std::string options;
  bool has_reals = false;  // also numbers of double precision
};

void Define(std::initializer_list<std::pair<const char*, float>> constants, std::string* options) {
  for (const auto& [name, value] : constants) absl::StrAppendFormat(options, " -D%s=%af", name, value);
}

ProgramText TextOf(const KernelOptions& options, bool has_doubles) {
  ProgramText text = {
      {kProbeKernels, kSharedKernels, kRealsKernels, kManifoldKernels, kCovarianceKernels,
       kProjectionKernels},
      absl::StrFormat("-DFEATURES=%d -DCHANNELS=%d -DFITS=%d -DSTEP=%d -DMOST_FEATURES=%d -DMOST_PLANES=%d "
                      "-DMOST_STEP=%d -DDOUBLES=%d -DkLeastSpread=0x%xUL",
                      options.features, options.channels, options.fits ? 1 : 0, options.step,
                      options.features, options.planes(), options.step, has_doubles ? 1 : 0,
                      std::bit_cast<uint64_t>(kLeastSpread)),
      true};
  Define({{"kFarthest", kFarthest},
          {"kSeam", kSeam},
          {"kSqrt2", kSqrt2},
          {"kLeastClusterMass", kLeastClusterMass},
          {"kParentMass", kParentMass},
          {"kLeastTotal", kLeastTotal},
          {"kLeastWeight", kLeastWeight},
          {"kMostDeviations", kMostDeviations}},
         &text.options);
  return text;
}

ProgramText TextOf(const FitShape& shape, bool) {
  ProgramText text = {
      {kProbeKernels, kSharedKernels, kFitKernels, kLightKernels},
      absl::StrFormat("-DFIT_TERMS=%d -DFIT_SIGNALS=%d -DFIT_TRAITS=%d -DMOST_FIT_ROW=%d -DkFitStep=%d "
                      "-DkMostLightTerms=%d -DkMostLightFeatures=%d",
                      shape.terms, shape.signals, shape.traits, shape.Row(), kFitStep, kMostLightTerms,
                      kMostLightFeatures)};
  Define({{"kMinFitPower", kMinFitPower},
          {"kMinFitRidge", kMinFitRidge},
          {"kMaxFitRidge", kMaxFitRidge},
          {"kMinModelWeight", kMinModelWeight},
          {"kMaxFitSquare", kMaxFitSquare},
          {"kMaxLightSignal", kMaxLightSignal}},
         &text.options);
  return text;
}

ProgramText TextOf(const LayerProgram&, bool has_doubles) {
  ProgramText text = {
      {kProbeKernels, kSharedKernels, kRealsKernels, kChoiceKernels, kLayerKernels, kEnergyKernels},
      absl::StrFormat("-DkChoiceCell=%d -DkMixedKind=%d -DkPointKind=%d -DkMostKinds=%d -DDOUBLES=%d",
                      kChoiceCell, kMixedKind, kPointKind, kMostKinds, has_doubles ? 1 : 0),
      true};
  Define({{"kMostLeverage", kMostLeverage}, {"kLargestFeature", kLargestFeature}}, &text.options);
  return text;
}

/// Finds or builds a program.
using FindProgram = std::function<absl::StatusOr<cl_program>(const ProgramOptions&)>;

class OpenClRun final : public KernelRun {
 public:
  OpenClRun(const OpenClLibrary& cl, cl_context context, cl_command_queue queue, FindProgram find)
      : cl_(cl), context_(context), queue_(queue), find_(std::move(find)) {}
  ~OpenClRun() override {
    for (cl_mem memory : buffers_) {
      if (memory != nullptr) cl_.clReleaseMemObject(memory);
    }
  }

  void Use(const ProgramOptions& options) override {
    if (!status_.ok()) return;
    const absl::StatusOr<cl_program> program = find_(options);
    if (program.ok()) program_ = *program;
    // Less memory for the work makes no program: that is a failure, not kResourceExhausted.
    status_.Update(absl::IsResourceExhausted(program.status())
                       ? absl::InternalError(program.status().message())
                       : program.status());
  }

  Buffer Allocate(size_t bytes) override {
    cl_mem memory = nullptr;
    if (status_.ok()) {
      cl_int error = CL_SUCCESS;
      memory = cl_.clCreateBuffer(context_, CL_MEM_READ_WRITE, std::max<size_t>(bytes, 1), nullptr, &error);
      Note(error, "clCreateBuffer");
    }
    buffers_.push_back(memory);
    return static_cast<Buffer>(buffers_.size() - 1);
  }

  void Release(Buffer buffer) override {
    cl_mem& memory = buffers_[static_cast<size_t>(buffer)];
    if (memory != nullptr) cl_.clReleaseMemObject(memory);
    memory = nullptr;
  }

  void Write(Buffer to, size_t offset, const void* from, size_t bytes) override {
    if (!status_.ok() || bytes == 0) return;
    Note(cl_.clEnqueueWriteBuffer(queue_, MemoryOf(to), CL_TRUE, offset, bytes, from, 0, nullptr, nullptr),
         "clEnqueueWriteBuffer");
  }

  void Copy(Buffer from, size_t from_offset, Buffer to, size_t to_offset, size_t bytes) override {
    if (!status_.ok() || bytes == 0) return;
    Note(cl_.clEnqueueCopyBuffer(queue_, MemoryOf(from), MemoryOf(to), from_offset, to_offset, bytes, 0,
                                 nullptr, nullptr),
         "clEnqueueCopyBuffer");
  }

  void Run(const char* kernel, size_t items, std::initializer_list<Argument> arguments) override {
    if (!status_.ok() || items == 0) return;
    cl_int error = CL_SUCCESS;
    const Held<cl_kernel> held(cl_.clCreateKernel(program_, kernel, &error), cl_.clReleaseKernel);
    if (!Note(error, kernel)) return;
    cl_uint index = 0;
    for (const Argument& argument : arguments) {
      const auto set = [&](const auto& value) {
        using Value = std::decay_t<decltype(value)>;
        // NOLINTNEXTLINE(bugprone-sizeof-expression): cl_mem is a pointer
        return cl_.clSetKernelArg(held.get(), index++, sizeof(Value), static_cast<const void*>(&value));
      };
      const auto set_any = [&](const auto& value) {
        if constexpr (std::is_same_v<std::decay_t<decltype(value)>, Buffer>)
          return set(MemoryOf(value));
        else
          return set(value);
      };
      if (!Note(std::visit(set_any, argument), kernel)) return;
    }
    const size_t global = (items + kGroup - 1) / kGroup * kGroup;
    Note(cl_.clEnqueueNDRangeKernel(queue_, held.get(), 1, nullptr, &global, &kGroup, 0, nullptr, nullptr),
         kernel);
  }

  absl::Status Finish() override {
    if (!status_.ok()) return status_;
    Note(cl_.clFinish(queue_), "clFinish");
    return status_;
  }

  absl::Status Read(Buffer from, size_t offset, size_t bytes, void* to) override {
    if (!status_.ok() || bytes == 0) return status_;
    Note(cl_.clEnqueueReadBuffer(queue_, MemoryOf(from), CL_TRUE, offset, bytes, to, 0, nullptr, nullptr),
         "clEnqueueReadBuffer");
    return status_;
  }

 private:
  bool Note(cl_int error, const char* what) {
    status_.Update(OpenClStatus(error, what));
    return status_.ok();
  }
  cl_mem MemoryOf(Buffer buffer) const { return buffers_[static_cast<size_t>(buffer)]; }

  const OpenClLibrary& cl_;
  const cl_context context_;
  const cl_command_queue queue_;
  const FindProgram find_;
  cl_program program_ = nullptr;
  std::vector<cl_mem> buffers_;
  absl::Status status_;
};

/// Runs the kernel Probe, and ProbeReals where there is one, and compares with this processor.
absl::Status CheckBits(bool has_reals, KernelRun* run) {
  constexpr int32_t kPairs = 4096;
  std::vector<float> a, b;
  for (uint32_t i = 0; i < kPairs; ++i) {  // from 2^-15 to 2^16, all bits of the mantissa
    const auto number = [](uint32_t bits) { return std::bit_cast<float>((bits & 0x0fffffff) + 0x38000000); };
    a.push_back(number(static_cast<uint32_t>(MixBits(2 * i))));
    b.push_back(number(static_cast<uint32_t>(MixBits(2 * i + 1))));
  }
  std::vector<float> singles(4 * kPairs), found_singles(singles.size());
  std::vector<double> doubles(3 * kPairs), found_doubles(doubles.size());
  for (size_t i = 0; i < kPairs; ++i) {
    const float product = a[i] * b[i];
    const auto u = static_cast<double>(a[i]), v = static_cast<double>(b[i]);
    const float expected[] = {a[i] / b[i], std::sqrt(a[i]), product + a[i], product * 1e-39f};
    std::copy_n(expected, 4, singles.begin() + static_cast<std::ptrdiff_t>(4 * i));
    const double wide[] = {u / v, std::sqrt(u), u * (v / 3.0) + u};
    std::copy_n(wide, 3, doubles.begin() + static_cast<std::ptrdiff_t>(3 * i));
  }
  const size_t pair_bytes = kPairs * sizeof(float);
  const KernelRun::Buffer device_a = run->Allocate(pair_bytes), device_b = run->Allocate(pair_bytes);
  const size_t single_bytes = singles.size() * sizeof(float), double_bytes = doubles.size() * sizeof(double);
  const KernelRun::Buffer device_singles = run->Allocate(single_bytes);
  const KernelRun::Buffer device_doubles = run->Allocate(double_bytes);
  run->Write(device_a, 0, a.data(), pair_bytes);
  run->Write(device_b, 0, b.data(), pair_bytes);
  run->Run("Probe", kPairs, {kPairs, device_a, device_b, device_singles});
  if (has_reals) run->Run("ProbeReals", kPairs, {kPairs, device_a, device_b, device_doubles});
  absl::Status status = run->Finish();
  if (status.ok()) status = run->Read(device_singles, 0, single_bytes, found_singles.data());
  if (status.ok()) status = run->Read(device_doubles, 0, double_bytes, found_doubles.data());
  if (!status.ok()) return status;
  if (std::memcmp(singles.data(), found_singles.data(), single_bytes) == 0 &&
      (!has_reals || std::memcmp(doubles.data(), found_doubles.data(), double_bytes) == 0))
    return absl::OkStatus();
  return absl::FailedPreconditionError("its numbers differ from this processor's, against what it reports");
}

class OpenClDevice final : public Device {
 public:
  OpenClDevice(const OpenClLibrary& cl, cl_device_id device)
      : cl_(cl),
        device_(device),
        has_doubles_(HasDoubles(cl, device)),
        has_own_bits_(OtherBitsOf(cl, device).empty()),
        context_(nullptr, cl.clReleaseContext),
        queue_(nullptr, cl.clReleaseCommandQueue) {}

  absl::Status Open() {
    cl_int error = CL_SUCCESS;
    context_.reset(cl_.clCreateContext(nullptr, 1, &device_, nullptr, nullptr, &error));
    if (error != CL_SUCCESS) return OpenClStatus(error, "clCreateContext");
    queue_.reset(cl_.clCreateCommandQueue(context_.get(), device_, 0, &error));
    return OpenClStatus(error, "clCreateCommandQueue");
  }

  DeviceMemory Memory() const override {
    return {NumberOf<cl_ulong>(cl_, device_, CL_DEVICE_GLOBAL_MEM_SIZE),
            NumberOf<cl_ulong>(cl_, device_, CL_DEVICE_MAX_MEM_ALLOC_SIZE)};
  }

  std::unique_ptr<KernelRun> Begin() override {
    return std::make_unique<OpenClRun>(cl_, context_.get(), queue_.get(),
                                       [this](const ProgramOptions& options) { return Find(options); });
  }

 private:
  absl::StatusOr<cl_program> Find(const ProgramOptions& options) {
    auto found = programs_.find(options);
    if (found == programs_.end()) {
      const ProgramText text = std::visit([&](const auto& of) { return TextOf(of, has_doubles_); }, options);
      absl::StatusOr<Held<cl_program>> program = Build(text);
      if (!program.ok()) return program.status();
      OpenClRun probe(cl_, context_.get(), queue_.get(),
                      [&](const ProgramOptions&) { return program->get(); });
      probe.Use(options);
      absl::Status status = has_own_bits_ ? CheckBits(text.has_reals, &probe) : absl::OkStatus();
      if (!status.ok()) return status;
      found = programs_.emplace(options, *std::move(program)).first;
    }
    return found->second.get();
  }

  absl::StatusOr<Held<cl_program>> Build(const ProgramText& text) const {
    std::vector<const char*> sources = text.sources;
    const std::string options = absl::StrCat(
        "-cl-std=CL1.2 ", has_own_bits_ ? "-cl-fp32-correctly-rounded-divide-sqrt " : "", text.options);
    cl_int error = CL_SUCCESS;
    Held<cl_program> program(
        cl_.clCreateProgramWithSource(context_.get(), static_cast<cl_uint>(sources.size()), sources.data(),
                                      nullptr, &error),
        cl_.clReleaseProgram);
    if (error != CL_SUCCESS) return OpenClStatus(error, "clCreateProgramWithSource");
    error = cl_.clBuildProgram(program.get(), 1, &device_, options.c_str(), nullptr, nullptr);
    if (error == CL_SUCCESS) return program;
    std::vector<char> log(size_t{1} << 14);
    cl_.clGetProgramBuildInfo(program.get(), device_, CL_PROGRAM_BUILD_LOG, log.size() - 1, log.data(),
                              nullptr);
    return absl::InternalError(
        absl::StrCat(OpenClStatus(error, "clBuildProgram").message(), "\n", log.data()));
  }

  const OpenClLibrary& cl_;
  const cl_device_id device_;
  const bool has_doubles_;
  const bool has_own_bits_;
  Held<cl_context> context_;
  Held<cl_command_queue> queue_;
  std::map<ProgramOptions, Held<cl_program>> programs_;
};

}  // namespace

absl::StatusOr<std::vector<DeviceInfo>> ListDevices() {
  const absl::StatusOr<const OpenClLibrary*> library = LoadOpenCl();
  if (!library.ok()) return library.status();
  const OpenClLibrary& cl = **library;
  std::vector<DeviceInfo> devices;
  for (cl_device_id device : FindDevices(cl)) {
    devices.push_back(
        {.name = TextOf(cl, device, CL_DEVICE_NAME),
         .driver = absl::StrCat(TextOf(cl, device, CL_DEVICE_VERSION), ", driver ",
                                TextOf(cl, device, CL_DRIVER_VERSION)),
         .is_gpu = (NumberOf<cl_device_type>(cl, device, CL_DEVICE_TYPE) & CL_DEVICE_TYPE_GPU) != 0,
         .memory_bytes = NumberOf<cl_ulong>(cl, device, CL_DEVICE_GLOBAL_MEM_SIZE),
         .refusal = RefusalOf(cl, device),
         .other_bits = OtherBitsOf(cl, device)});
  }
  return devices;
}

absl::StatusOr<std::unique_ptr<Device>> OpenDevice(size_t number, bool allows_other_bits) {
  const absl::StatusOr<const OpenClLibrary*> library = LoadOpenCl();
  if (!library.ok()) return library.status();
  const std::vector<cl_device_id> devices = FindDevices(**library);
  if (number >= devices.size())
    return absl::OutOfRangeError(absl::StrCat("there is no device ", number, " of OpenCL"));
  const std::string refusal = RefusalOf(**library, devices[number]);
  if (!refusal.empty()) return absl::FailedPreconditionError(refusal);
  const std::string other_bits = OtherBitsOf(**library, devices[number]);
  if (!other_bits.empty() && !allows_other_bits)
    return absl::FailedPreconditionError(absl::StrCat(TextOf(**library, devices[number], CL_DEVICE_NAME),
                                                      " has other bits: ", other_bits,
                                                      ". --allow-other-bits takes it all the same"));
  auto device = std::make_unique<OpenClDevice>(**library, devices[number]);
  if (absl::Status status = device->Open(); !status.ok()) return status;
  return device;
}

}  // namespace lumifold::filter
