#include "filter/opencl/open_device.h"

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <mutex>
#include <optional>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "filter/opencl/device.h"
#include "filter/opencl/fit_run.h"
#include "filter/opencl/layer_run.h"
#include "filter/opencl/manifold_run.h"

namespace lumifold::filter {
namespace {

constexpr std::string_view kNumbered = "gpu:";
/// Of the kernel's drivers and NVIDIA's, AMD's, WSL's and ARM's.
constexpr const char* kGpuFiles[] = {"/dev/dri", "/dev/nvidiactl", "/dev/kfd", "/dev/dxg", "/dev/mali0"};

class OpenClFilterDevice final : public FilterDevice {
 public:
  OpenClFilterDevice(std::unique_ptr<Device> device, DeviceWarning warn, std::string other_bits)
      : warn_(std::move(warn)),
        other_bits_(std::move(other_bits)),
        device_(std::move(device)),
        memory_(device_->Memory()) {}

  std::string OtherBits() const override { return other_bits_; }

  std::optional<ManifoldResult> Filter(const ManifoldCall& call) override { return Do(call, RunManifolds); }
  std::optional<FitResult> Fit(const FitCall& call) override { return Do(call, RunFit); }
  std::optional<LayerResult> FilterLayer(const LayerCall& call) override { return Do(call, RunLayerCall); }

 private:
  /// Work by kernels in the memory that can be had.
  template <typename Call, typename Parameter, typename Result>
  std::optional<Result> Do(const Call& call,
                           absl::StatusOr<Result> (*work)(Parameter, const DeviceMemory&, KernelRun*)) {
    const DeviceMemory least = LeastMemory(call);
    const std::lock_guard lock(mutex_);
    while (!has_failed_) {
      if (!memory_.Holds(least)) {
        Leave(least);
        return std::nullopt;
      }
      absl::StatusOr<Result> result = work(call, memory_, device_->Begin().get());
      if (result.ok()) return *std::move(result);
      if (absl::IsResourceExhausted(result.status())) {
        memory_.whole = TakenMemory(call, memory_).whole / 4 * 3;  // others use the rest
        continue;
      }
      has_failed_ = true;
      warn_(true, std::string(result.status().message()));
    }
    return std::nullopt;
  }

  void Leave(const DeviceMemory& least) {
    if (std::exchange(has_left_, true)) return;
    constexpr double kMega = 1e6;
    const auto mega = [](uint64_t bytes) { return static_cast<double>(bytes) / kMega; };
    warn_(false, absl::StrFormat(
                     "it has %.1f MB of memory, %.1f MB in one buffer, and %.1f and %.1f MB are needed",
                     mega(memory_.whole), mega(memory_.largest), mega(least.whole), mega(least.largest)));
  }

  const DeviceWarning warn_;
  const std::string other_bits_;
  std::mutex mutex_;
  const std::unique_ptr<Device> device_;  // used by one thread at a time
  DeviceMemory memory_;                   // that can be had
  bool has_failed_ = false;
  bool has_left_ = false;  // some work to the processor
};

/// The number in "gpu:N"; nullopt for another word.
std::optional<size_t> NumberIn(std::string_view choice) {
  uint32_t number = 0;
  if (choice.substr(0, kNumbered.size()) != kNumbered ||
      !absl::SimpleAtoi(std::string(choice.substr(kNumbered.size())), &number))
    return std::nullopt;
  return number;
}

absl::StatusOr<size_t> FirstGpu(const std::vector<DeviceInfo>& devices, bool allows_other_bits) {
  std::string refusals;
  std::optional<size_t> with_other_bits;
  for (size_t i = 0; i < devices.size(); ++i) {
    const DeviceInfo& device = devices[i];
    if (!device.is_gpu) continue;
    if (device.refusal.empty() && device.other_bits.empty()) return i;
    if (device.refusal.empty() && !with_other_bits.has_value()) with_other_bits = i;
    absl::StrAppend(&refusals, "; ", device.name, ": ",
                    device.refusal.empty() ? device.other_bits : device.refusal);
  }
  if (with_other_bits.has_value() && allows_other_bits) return *with_other_bits;
  return absl::FailedPreconditionError(
      absl::StrCat("OpenCL has no GPU here that gives this processor's bits", refusals,
                   with_other_bits.has_value() ? ". --allow-other-bits takes it all the same" : ""));
}

/// A hash of the device and its driver, which decide the bits.
std::string NameOfBits(const DeviceInfo& device) {
  uint32_t hash = 2166136261;  // FNV-1a
  for (const char c : absl::StrCat(device.name, "\n", device.driver))
    hash = (hash ^ static_cast<uint8_t>(c)) * 16777619;
  return absl::StrCat(absl::Hex(hash, absl::kZeroPad8));
}

absl::StatusOr<OpenedDevice> Open(const DeviceChoice& choice, DeviceWarning warn) {
  const absl::StatusOr<std::vector<DeviceInfo>> devices = ListDevices();
  if (!devices.ok()) return devices.status();
  absl::StatusOr<size_t> number = 0;
  if (const std::optional<size_t> named = NumberIn(choice.word))
    number = *named;
  else
    number = FirstGpu(*devices, choice.allows_other_bits);
  if (!number.ok()) return number.status();
  absl::StatusOr<std::unique_ptr<Device>> device = OpenDevice(*number, choice.allows_other_bits);
  if (!device.ok()) return device.status();
  const DeviceInfo& info = (*devices)[*number];
  return OpenedDevice{info.name, MakeFilterDevice(*std::move(device), std::move(warn),
                                                  info.other_bits.empty() ? "" : NameOfBits(info))};
}

}  // namespace

bool MayHaveGpu() {
  return std::any_of(std::begin(kGpuFiles), std::end(kGpuFiles), [](const char* path) {
    std::error_code ignored;  // what cannot be looked at cannot be used
    return std::filesystem::exists(path, ignored);
  });
}

std::shared_ptr<FilterDevice> MakeFilterDevice(std::unique_ptr<Device> device, DeviceWarning warn,
                                               std::string other_bits) {
  return std::make_shared<OpenClFilterDevice>(std::move(device), std::move(warn), std::move(other_bits));
}

absl::Status CheckDeviceChoice(std::string_view choice) {
  if (choice == "auto" || choice == "cpu" || choice == "gpu" || NumberIn(choice).has_value())
    return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat("\"", std::string(choice), "\" is no device; there are: auto, cpu, gpu, gpu:N"));
}

absl::StatusOr<OpenedDevice> OpenFilterDevice(const DeviceChoice& choice, DeviceWarning warn) {
  if (absl::Status status = CheckDeviceChoice(choice.word); !status.ok()) return status;
  if (choice.word == "cpu") return OpenedDevice{};
  absl::StatusOr<OpenedDevice> device = Open(choice, std::move(warn));
  if (!device.ok() && choice.word == "auto") return OpenedDevice{};
  return device;
}

}  // namespace lumifold::filter
