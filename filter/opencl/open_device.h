#pragma once

#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "filter/manifold/filter_device.h"
#include "filter/opencl/device.h"

namespace lumifold::filter {

/// Receives why a device is given up, or leaves some work to the processor.
using DeviceWarning = std::function<void(bool has_failed, const std::string& reason)>;

/// Whether OpenFilterDevice() knows the word: "auto", "cpu", "gpu" or "gpu:N". Asks no driver.
/// Errors: kInvalidArgument.
absl::Status CheckDeviceChoice(std::string_view choice);

/// Whether this machine has a file by which drivers reach a GPU. Asks no driver, which would take longer.
bool MayHaveGpu();

/// Filters on `device`. If it fails it is given up for good: `warn` is told, once, and the processor filters.
/// What needs more memory than it has is left to the processor, of which `warn` is told once. Where it has
/// less than it says, less is tried. `other_bits`: as FilterDevice::OtherBits.
std::shared_ptr<FilterDevice> MakeFilterDevice(std::unique_ptr<Device> device, DeviceWarning warn,
                                               std::string other_bits = "");

struct DeviceChoice {
  /// One that CheckDeviceChoice() knows.
  std::string word = "auto";
  /// Also a device whose bits are not this processor's.
  bool allows_other_bits = false;
};

struct OpenedDevice {
  std::string name;
  std::shared_ptr<FilterDevice> device;  // null: there is none
};

/// MakeFilterDevice with the device that is chosen, opened:
///   cpu    none;
///   gpu    the first GPU that gives this processor's bits, or else, where allowed, others;
///   gpu:N  device N of ListDevices(), whatever it is;
///   auto   that of gpu, or none where there is none.
/// Errors: those of CheckDeviceChoice and OpenDevice; kFailedPrecondition: there is no such GPU.
absl::StatusOr<OpenedDevice> OpenFilterDevice(const DeviceChoice& choice, DeviceWarning warn);

}  // namespace lumifold::filter
