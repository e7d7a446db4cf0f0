#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "absl/types/span.h"
#include "filter/image/planes.h"
#include "filter/manifold/filter_device.h"
#include "filter/manifold/manifold_filter.h"
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

// Without padding: no byte of this process's memory goes with what is sent.

/// filter::ManifoldParams.
struct ParamsHeader {
  float sigma_s, slope_ridge;
  int32_t levels, pca_iterations, cell;
  uint32_t keeps_mass, is_first_order;
};
ParamsHeader ParamsHeaderOf(const filter::ManifoldParams& params);
filter::ManifoldParams ParamsOf(const ParamsHeader& header);
bool IsValid(const ParamsHeader& header);
bool IsTree(int32_t levels);
bool IsReach(float reach);

/// Points of calls: numbers of what their pictures have.
struct PointLimits {
  int32_t width, height;
  uint32_t features, signals;
};
bool CanSend(const filter::SlicePoints& points, const PointLimits& limits);
/// Those that are not `first` have none of its places and features with them where these are the same.
bool SendPoints(const filter::SlicePoints& points, const filter::SlicePoints& first, SocketStream* to);
/// Adds points. False: the other end is closed, or they are none within the limits.
bool ReceivePoints(const PointLimits& limits, SocketStream* from, std::vector<filter::SlicePoints>* all);

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

struct PlaneCount {
  size_t count;
  int32_t width, height;
};
bool SendPlanes(const filter::PlaneViews& planes, SocketStream* to);
/// Adds planes.
bool ReceivePlanes(const PlaneCount& planes, SocketStream* from, Planes* received);

}  // namespace lumifold::device
