#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "absl/types/span.h"
#include "filter/image/planes.h"
#include "proto/device/call_messages.h"
#include "proto/device/socket_stream.h"

namespace lumifold::device {

// What messages to devices have in common.

// What a call may have at most: far above what our methods ask for, and such that products of these numbers
// with sizes of values fit their types.
inline constexpr int32_t kMostSide = 1 << 16;
inline constexpr int64_t kMostPixels = int64_t{1} << 27;
inline constexpr uint32_t kMostPlanes = 64;
inline constexpr int32_t kMostRadius = 64;

inline bool IsSize(int32_t width, int32_t height) {
  const auto is_side = [](int32_t side) { return side >= 1 && side <= kMostSide; };
  return is_side(width) && is_side(height) && int64_t{width} * height <= kMostPixels;
}
inline bool IsCount(uint32_t planes) { return planes >= 1 && planes <= kMostPlanes; }
inline bool IsPositive(float value, float most) { return value > 0 && value <= most; }

inline bool SendOperation(Operation operation, SocketStream* to) {
  return to->Write(&operation, sizeof(operation));
}

template <typename T>
bool SendList(absl::Span<const T> values, SocketStream* to) {
  return to->Write(values.data(), values.size() * sizeof(T));
}

template <typename T>
bool SendList(const std::vector<T>& values, SocketStream* to) {
  return to->Write(values.data(), values.size() * sizeof(T));
}

template <typename T>
bool ReceiveList(size_t count, SocketStream* from, std::vector<T>* values) {
  values->resize(count);
  return from->Read(values->data(), count * sizeof(T));
}

inline bool SendPlanes(const Planes& planes, SocketStream* to) {
  bool works = true;
  for (const Plane& plane : planes) works = works && to->WriteRows(plane.view());
  return works;
}

inline bool ReceivePlanes(SocketStream* from, Planes* planes) {
  bool works = true;
  for (Plane& plane : *planes) works = works && from->ReadRows(plane.view());
  return works;
}

}  // namespace lumifold::device
