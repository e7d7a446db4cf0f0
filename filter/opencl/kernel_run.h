#pragma once

#include <algorithm>
#include <compare>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <variant>
#include <vector>

#include "absl/status/status.h"
#include "filter/image/plane.h"
#include "filter/manifold/fit_call.h"

namespace lumifold::filter {

/// What the kernels of manifold.cl are made for.
struct KernelOptions {
  int features = 1;
  int channels = 3;   // of the signals
  bool fits = false;  // planes: ManifoldParams::is_first_order
  int step = 1;       // side of a cell, pixels

  /// Signals that are splatted and then sliced, with the weight.
  int planes() const { return fits ? 15 : channels + 1; }
  auto operator<=>(const KernelOptions&) const = default;
};

/// The program of layers: choice.cl, layer.cl and energy.cl.
struct LayerProgram {
  auto operator<=>(const LayerProgram&) const = default;
};

/// What a program is made for: the manifolds, fit.cl, or layers.
using ProgramOptions = std::variant<KernelOptions, FitShape, LayerProgram>;

/// As fit.cl has it.
struct FitWindow {
  int32_t width, height;
  int32_t radius;
  float falloff;
};

/// As shared.cl has it.
struct Grid {
  int32_t width, height;
  int32_t columns, rows;
  int32_t points;
};

/// Bytes of a device: all that is allocated at a time, and the largest buffer.
struct DeviceMemory {
  uint64_t whole = UINT64_MAX;
  uint64_t largest = UINT64_MAX;

  bool Holds(const DeviceMemory& need) const { return need.whole <= whole && need.largest <= largest; }
};

/// Buffers that are there at the same time, by their numbers of floats.
inline DeviceMemory Together(std::initializer_list<uint64_t> floats) {
  DeviceMemory need = {0, 0};
  for (const uint64_t count : floats) {
    need.whole += count * sizeof(float);
    need.largest = std::max(need.largest, count * sizeof(float));
  }
  return need;
}

/// What is left of memory.
inline DeviceMemory Less(DeviceMemory memory, const DeviceMemory& taken) {
  memory.whole -= std::min(memory.whole, taken.whole);
  return memory;
}
/// Both at the same time.
inline DeviceMemory More(const DeviceMemory& need, const DeviceMemory& other) {
  return {need.whole + other.whole, std::max(need.largest, other.largest)};
}
/// Extends `all` to what either needs.
inline void Extend(const DeviceMemory& need, DeviceMemory* all) {
  *all = {std::max(all->whole, need.whole), std::max(all->largest, need.largest)};
}

/// A count as kernels have it.
inline int32_t Int(uint64_t count) { return static_cast<int32_t>(count); }

/// One use of the kernels: memory, and work in the order of the calls. After an error the calls do nothing.
/// Threads: one.
class KernelRun {
 public:
  enum class Buffer : size_t {};
  using Argument = std::variant<Buffer, Grid, FitWindow, int32_t, float>;

  virtual ~KernelRun() = default;

  /// The kernels that follow are those of this program.
  virtual void Use(const ProgramOptions& program) = 0;
  /// Memory of any value; `bytes` may be 0.
  virtual Buffer Allocate(size_t bytes) = 0;
  /// Frees memory once the work that was given before has ended.
  virtual void Release(Buffer buffer) = 0;
  /// `from` may change after the call.
  virtual void Write(Buffer to, size_t offset, const void* from, size_t bytes) = 0;
  /// Within the device.
  virtual void Copy(Buffer from, size_t from_offset, Buffer to, size_t to_offset, size_t bytes) = 0;
  /// Runs `items` work-items of a kernel.
  virtual void Run(const char* kernel, size_t items, std::initializer_list<Argument> arguments) = 0;
  /// Waits for all work.
  /// Errors: the first of all calls: kResourceExhausted for memory, others of the device, naming the call, or
  /// of a program.
  virtual absl::Status Finish() = 0;
  /// After Finish().
  virtual absl::Status Read(Buffer from, size_t offset, size_t bytes, void* to) = 0;

  /// Writes the pixels of a plane, row by row.
  void WritePlane(ConstFloatView plane, Buffer to, size_t offset_bytes) {
    const auto width = static_cast<size_t>(plane.width());
    std::vector<float> values;
    values.reserve(width * static_cast<size_t>(plane.height()));
    for (int y = 0; y < plane.height(); ++y) values.insert(values.end(), plane.Row(y), plane.Row(y) + width);
    Write(to, offset_bytes, values.data(), values.size() * sizeof(float));
  }
  Buffer Floats(uint64_t count) { return Allocate(count * sizeof(float)); }
  /// A buffer of these values.
  template <typename Values>
  Buffer Upload(const Values& values) {
    const size_t bytes = values.size() * sizeof(values[0]);
    const Buffer buffer = Allocate(bytes);
    Write(buffer, 0, values.data(), bytes);
    return buffer;
  }
};

}  // namespace lumifold::filter
