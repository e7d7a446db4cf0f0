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
  /// Why it does not give the bits of this processor; empty: it says that it does.
  std::string refusal;
};

/// All devices of this machine, numbered from 0.
/// Errors: kFailedPrecondition: it has no OpenCL.
absl::StatusOr<std::vector<DeviceInfo>> ListDevices();

/// A device with its context, its queue and the programs that were built for it.
/// Threads: one at a time.
class Device {
 public:
  virtual ~Device() = default;

  /// Builds the kernels, unless it has, and checks that they give this processor's bits.
  /// Errors: kFailedPrecondition: they do not; kInternal with the compiler's words.
  /// The device must outlive the run.
  virtual absl::StatusOr<std::unique_ptr<KernelRun>> Begin(const KernelOptions& options) = 0;
};

/// Opens device `number` of ListDevices().
/// Errors: kOutOfRange: there is none of that number; kFailedPrecondition with DeviceInfo::refusal.
absl::StatusOr<std::unique_ptr<Device>> OpenDevice(size_t number);

}  // namespace lumifold::filter
