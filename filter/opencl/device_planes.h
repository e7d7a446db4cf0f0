#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <vector>

#include "absl/types/span.h"
#include "filter/manifold/filter_device.h"
#include "filter/opencl/kernel_run.h"

namespace lumifold::filter {

/// Writes the pixels of a plane, row by row.
void UploadPlane(ConstFloatView plane, KernelRun::Buffer to, size_t offset_bytes, KernelRun* run);

/// Planes of calls that several use, a buffer each.
uint64_t SharedPlanes(absl::Span<const ManifoldCall> calls);

/// Brings the planes of calls to the device: those that several calls use once, if they stay there.
class DevicePlanes {
 public:
  DevicePlanes(absl::Span<const ManifoldCall> calls, bool stay, KernelRun* run);

  /// Writes the pixels of a plane of one of the calls, row by row.
  void Put(ConstFloatView plane, KernelRun::Buffer to, size_t offset_bytes);

 private:
  KernelRun& run_;
  std::map<const float*, int> uses_;  // of planes that stay; by the first pixel
  std::map<const float*, KernelRun::Buffer> here_;
};

}  // namespace lumifold::filter
