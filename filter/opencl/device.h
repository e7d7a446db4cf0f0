#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "filter/opencl/kernel_run.h"

namespace lumifold::filter {

/// A device of OpenCL.
struct DeviceInfo {
  std::string name;
  std::string driver;  // the platform's name and version
  bool is_gpu = false;
  uint64_t memory_bytes = 0;
  /// Why it cannot filter; empty: it can.
  std::string refusal;
  /// Why its bits are not this processor's; empty: it says that they are.
  std::string other_bits;
};

/// All devices of this machine, numbered from 0.
/// Errors: kFailedPrecondition: it has no OpenCL.
absl::StatusOr<std::vector<DeviceInfo>> ListDevices();

/// A device with its context, its queue and the programs that were built for it.
/// Threads: one at a time.
class Device {
 public:
  virtual ~Device() = default;

  /// What the driver says; others may use of it.
  virtual DeviceMemory Memory() const = 0;

  /// A run, which the device must outlive. It builds the programs that it uses, unless the device has them,
  /// and checks that they give this processor's bits, unless others are allowed.
  /// Errors of a program: kFailedPrecondition: it does not; kInternal with the compiler's words.
  virtual std::unique_ptr<KernelRun> Begin() = 0;
};

/// Opens device `number` of ListDevices(). With `allows_other_bits` the kernels of a device that has other
/// bits are not checked.
/// Errors: kOutOfRange: there is none of that number; kFailedPrecondition with DeviceInfo::refusal, or with
/// DeviceInfo::other_bits where they are not allowed.
absl::StatusOr<std::unique_ptr<Device>> OpenDevice(size_t number, bool allows_other_bits);

}  // namespace lumifold::filter
