#include "filter/opencl/device_planes.h"

#include <algorithm>

namespace lumifold::filter {
namespace {

/// How often calls use each plane, which its first pixel tells from others.
std::map<const float*, int> UsesOf(absl::Span<const ManifoldCall> calls) {
  std::map<const float*, int> uses;
  for (const ManifoldCall& call : calls) {
    for (const PlaneViews* views : {&call.signals, &call.patches.color, &call.features}) {
      for (const ConstFloatView& view : *views) ++uses[view.Row(0)];
    }
    ++uses[call.mask.Row(0)];
  }
  return uses;
}

}  // namespace

uint64_t SharedPlanes(absl::Span<const ManifoldCall> calls) {
  const std::map<const float*, int> uses = UsesOf(calls);
  return static_cast<uint64_t>(
      std::count_if(uses.begin(), uses.end(), [](const auto& use) { return use.second > 1; }));
}

DevicePlanes::DevicePlanes(absl::Span<const ManifoldCall> calls, bool stay, KernelRun* run) : run_(*run) {
  if (stay) uses_ = UsesOf(calls);
}

void UploadPlane(ConstFloatView plane, KernelRun::Buffer to, size_t offset_bytes, KernelRun* run) {
  const auto width = static_cast<size_t>(plane.width());
  std::vector<float> values;
  values.reserve(width * static_cast<size_t>(plane.height()));
  for (int y = 0; y < plane.height(); ++y) values.insert(values.end(), plane.Row(y), plane.Row(y) + width);
  run->Write(to, offset_bytes, values.data(), values.size() * sizeof(float));
}

void DevicePlanes::Put(ConstFloatView plane, KernelRun::Buffer to, size_t offset_bytes) {
  const float* const key = plane.Row(0);
  const auto uses = uses_.find(key);
  if (uses == uses_.end() || uses->second == 1) return UploadPlane(plane, to, offset_bytes, &run_);
  const size_t bytes =
      static_cast<size_t>(plane.width()) * static_cast<size_t>(plane.height()) * sizeof(float);
  auto found = here_.find(key);
  if (found == here_.end()) {
    found = here_.emplace(key, run_.Allocate(bytes)).first;
    UploadPlane(plane, found->second, 0, &run_);
  }
  run_.Copy(found->second, 0, to, offset_bytes, bytes);
}

}  // namespace lumifold::filter
