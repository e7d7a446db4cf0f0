#pragma once

#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "filter/manifold/manifold_device.h"
#include "filter/opencl/device.h"

namespace lumifold::filter {

/// Receives one line about a device that fails.
using DeviceWarning = std::function<void(const std::string& line)>;

/// Whether OpenFilterDevice() knows the word: "auto", "cpu", "gpu" or "gpu:N". Asks no driver.
/// Errors: kInvalidArgument.
absl::Status CheckDeviceChoice(std::string_view choice);

/// Filters on `device`. If it fails it is given up for good: `warn` is told, once, and the processor filters.
std::shared_ptr<ManifoldDevice> MakeFilterDevice(std::string name, std::unique_ptr<Device> device,
                                                 DeviceWarning warn);

/// MakeFilterDevice with the device that is chosen, opened:
///   cpu    none: null;
///   gpu    the first GPU that gives this processor's bits;
///   gpu:N  device N of ListDevices(), whatever it is;
///   auto   that of gpu, or null where there is none.
/// Errors: those of CheckDeviceChoice and OpenDevice; kFailedPrecondition: there is no such GPU.
absl::StatusOr<std::shared_ptr<ManifoldDevice>> OpenFilterDevice(std::string_view choice, DeviceWarning warn);

}  // namespace lumifold::filter
