#include "filter/opencl/filter_device.h"

#include <algorithm>
#include <filesystem>
#include <mutex>
#include <optional>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "filter/opencl/device.h"
#include "filter/opencl/manifold_run.h"
#include "filter/opencl/projection_run.h"

namespace lumifold::filter {
namespace {

constexpr std::string_view kNumbered = "gpu:";
/// Of the kernel's drivers and NVIDIA's, AMD's, WSL's and ARM's.
constexpr const char* kGpuFiles[] = {"/dev/dri", "/dev/nvidiactl", "/dev/kfd", "/dev/dxg", "/dev/mali0"};

class FilterDevice final : public ManifoldDevice {
 public:
  FilterDevice(std::unique_ptr<Device> device, DeviceWarning warn)
      : warn_(std::move(warn)), device_(std::move(device)) {}

  std::optional<ManifoldResult> Filter(const ManifoldCall& call) override {
    return Run(KernelsOf(call), [&call](KernelRun* run) { return RunManifolds(call, run); });
  }
  std::optional<Planes> Project(const ProjectionCall& call) override {
    return Run({.kernels = Kernels::kProjection},
               [&call](KernelRun* run) { return RunProjection(call, run); });
  }

 private:
  /// What `work` makes with the kernels; nullopt once the device has failed.
  template <typename Work>
  auto Run(const KernelOptions& kernels, const Work& work)
      -> std::optional<typename decltype(work(nullptr))::value_type> {
    const std::lock_guard lock(mutex_);
    if (has_failed_) return std::nullopt;
    const absl::StatusOr<std::unique_ptr<KernelRun>> run = device_->Begin(kernels);
    absl::Status status = run.status();
    if (run.ok()) {
      auto result = work(run->get());
      if (result.ok()) return *std::move(result);
      status = result.status();
    }
    has_failed_ = true;
    warn_(std::string(status.message()));
    return std::nullopt;
  }

  const DeviceWarning warn_;
  std::mutex mutex_;
  const std::unique_ptr<Device> device_;  // used by one thread at a time
  bool has_failed_ = false;
};

/// The number in "gpu:N"; nullopt for another word.
std::optional<size_t> NumberIn(std::string_view choice) {
  uint32_t number = 0;
  if (choice.substr(0, kNumbered.size()) != kNumbered ||
      !absl::SimpleAtoi(std::string(choice.substr(kNumbered.size())), &number))
    return std::nullopt;
  return number;
}

absl::StatusOr<size_t> FirstGpu(const std::vector<DeviceInfo>& devices) {
  std::string refusals;
  for (size_t i = 0; i < devices.size(); ++i) {
    if (!devices[i].is_gpu) continue;
    if (devices[i].refusal.empty()) return i;
    absl::StrAppend(&refusals, "; ", devices[i].name, ": ", devices[i].refusal);
  }
  return absl::FailedPreconditionError(
      absl::StrCat("OpenCL has no GPU here that gives this processor's bits", refusals));
}

absl::StatusOr<OpenedDevice> Open(std::string_view choice, DeviceWarning warn) {
  const absl::StatusOr<std::vector<DeviceInfo>> devices = ListDevices();
  if (!devices.ok()) return devices.status();
  absl::StatusOr<size_t> number = 0;
  if (const std::optional<size_t> named = NumberIn(choice))
    number = *named;
  else
    number = FirstGpu(*devices);
  if (!number.ok()) return number.status();
  absl::StatusOr<std::unique_ptr<Device>> device = OpenDevice(*number);
  if (!device.ok()) return device.status();
  return OpenedDevice{(*devices)[*number].name, MakeFilterDevice(*std::move(device), std::move(warn))};
}

}  // namespace

bool MayHaveGpu() {
  return std::any_of(std::begin(kGpuFiles), std::end(kGpuFiles), [](const char* path) {
    std::error_code ignored;  // what cannot be looked at cannot be used
    return std::filesystem::exists(path, ignored);
  });
}

std::shared_ptr<ManifoldDevice> MakeFilterDevice(std::unique_ptr<Device> device, DeviceWarning warn) {
  return std::make_shared<FilterDevice>(std::move(device), std::move(warn));
}

absl::Status CheckDeviceChoice(std::string_view choice) {
  if (choice == "auto" || choice == "cpu" || choice == "gpu" || NumberIn(choice).has_value())
    return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat("\"", std::string(choice), "\" is no device; there are: auto, cpu, gpu, gpu:N"));
}

absl::StatusOr<OpenedDevice> OpenFilterDevice(std::string_view choice, DeviceWarning warn) {
  if (absl::Status status = CheckDeviceChoice(choice); !status.ok()) return status;
  if (choice == "cpu") return OpenedDevice{};
  absl::StatusOr<OpenedDevice> device = Open(choice, std::move(warn));
  if (!device.ok() && choice == "auto") return OpenedDevice{};
  return device;
}

}  // namespace lumifold::filter
