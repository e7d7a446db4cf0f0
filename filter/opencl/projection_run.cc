#include "filter/opencl/projection_run.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace lumifold::filter {

DeviceMemory MemoryOf(const ProjectionCall& call) {
  const uint64_t plane = sizeof(float) * static_cast<uint64_t>(call.color[0].width()) *
                         static_cast<uint64_t>(call.color[0].height());
  const uint64_t from = call.color.size() * plane, to = static_cast<uint64_t>(call.dimensions) * plane;
  return {from + to + call.taps.size() * sizeof(float), std::max(from, to)};
}

absl::StatusOr<Planes> RunProjection(const ProjectionCall& call, KernelRun* run) {
  const int width = call.color[0].width();
  const int height = call.color[0].height();
  const size_t row = static_cast<size_t>(width);
  const size_t pixels = row * static_cast<size_t>(height);
  const size_t dimensions = static_cast<size_t>(call.dimensions);
  const KernelRun::Buffer color = run->Allocate(call.color.size() * pixels * sizeof(float));
  const KernelRun::Buffer taps = run->Allocate(call.taps.size() * sizeof(float));
  const KernelRun::Buffer coordinates = run->Allocate(dimensions * pixels * sizeof(float));
  std::vector<float> values(pixels);
  for (size_t c = 0; c < call.color.size(); ++c) {
    for (int y = 0; y < height; ++y)
      std::copy_n(call.color[c].Row(y), row, values.data() + static_cast<size_t>(y) * row);
    run->Write(color, c * pixels * sizeof(float), values.data(), pixels * sizeof(float));
  }
  run->Write(taps, 0, call.taps.data(), call.taps.size() * sizeof(float));
  run->Run("Project", dimensions * pixels,
           {width, height, static_cast<int32_t>(call.color.size()), call.dimensions, call.radius, color, taps,
            coordinates});
  if (absl::Status status = run->Finish(); !status.ok()) return status;
  Planes planes = MakeUninitializedPlanes(dimensions, width, height);
  for (size_t k = 0; k < dimensions; ++k) {
    const size_t bytes = pixels * sizeof(float);
    if (absl::Status status = run->Read(coordinates, k * bytes, bytes, values.data()); !status.ok())
      return status;
    for (int y = 0; y < height; ++y)
      std::copy_n(values.data() + static_cast<size_t>(y) * row, row, planes[k].Row(y));
  }
  return planes;
}

}  // namespace lumifold::filter
