#include "proto/device/call_messages.h"

#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "filter/image/planes.h"
#include "filter/manifold/first_order.h"

namespace lumifold::device {
namespace {

using filter::ManifoldCall;
using filter::ManifoldResult;
using filter::SlicePoints;

// What a call may have at most: far above what our methods ask for, and such that products of these numbers
// with sizes of values fit their types.
constexpr int32_t kMostSide = 1 << 16;
constexpr int64_t kMostPixels = int64_t{1} << 27;
constexpr uint32_t kMostPlanes = 64;
constexpr uint32_t kMostPoints = 1U << 27;
constexpr uint32_t kMostSamples = 1 << 10;
constexpr float kMostReach = 1 << 16;

/// Without padding: no byte of this process's memory goes with it.
struct CallHeader {
  int32_t width, height;
  uint32_t signals, features;
  float sigma_s, slope_ridge, reach, pixel_divisor;
  int32_t levels, pca_iterations, cell;
  uint32_t keeps_mass, is_first_order;
  // Of the points; 0 without any.
  uint32_t has_points, points_have_signals;
  uint32_t point_pixels, samples, own_features;
};

bool IsPositive(float value, float most) { return value > 0 && value <= most; }

bool HasValidPoints(const CallHeader& header) {
  if (header.has_points == 0) return true;
  if (header.samples < 1 || header.samples > kMostSamples || header.own_features > header.features)
    return false;
  return uint64_t{header.point_pixels} * header.samples <= kMostPoints / kMostPlanes &&
         std::isfinite(header.pixel_divisor);
}

bool IsValid(const CallHeader& header) {
  const auto is_side = [](int32_t side) { return side >= 1 && side <= kMostSide; };
  if (!is_side(header.width) || !is_side(header.height)) return false;
  if (int64_t{header.width} * header.height > kMostPixels) return false;
  if (header.features < 1 || header.features > kMostPlanes) return false;
  if (header.signals < 1 || header.signals > kMostPlanes) return false;
  if (header.is_first_order != 0 && header.signals != 3) return false;
  if (header.levels < 1 || header.levels > 8) return false;
  if (header.pca_iterations < 1 || header.pca_iterations > 1000) return false;
  if (header.cell < 0 || header.cell > kBandRows || (header.cell & (header.cell - 1)) != 0) return false;
  return IsPositive(header.sigma_s, kMostReach) && IsPositive(header.reach, kMostReach) &&
         std::isfinite(header.slope_ridge) && HasValidPoints(header);
}

bool SendPlane(ConstFloatView plane, SocketStream* to) {
  bool works = true;
  for (int y = 0; works && y < plane.height(); ++y)
    works = to->Write(plane.Row(y), static_cast<size_t>(plane.width()) * sizeof(float));
  return works;
}

bool ReceivePlane(SocketStream* from, Plane* plane) {
  bool works = true;
  for (int y = 0; works && y < plane->height(); ++y)
    works = from->Read(plane->Row(y), static_cast<size_t>(plane->width()) * sizeof(float));
  return works;
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

bool SendPlanes(const Planes& planes, SocketStream* to) {
  bool works = true;
  for (const Plane& plane : planes) works = works && SendPlane(plane.view(), to);
  return works;
}

bool ReceivePlanes(SocketStream* from, Planes* planes) {
  bool works = true;
  for (Plane& plane : *planes) works = works && ReceivePlane(from, &plane);
  return works;
}

CallHeader HeaderOf(const ManifoldCall& call) {
  const filter::ManifoldParams& params = call.params;
  CallHeader header = {.width = call.mask.width(),
                       .height = call.mask.height(),
                       .signals = static_cast<uint32_t>(call.signals.size()),
                       .features = static_cast<uint32_t>(call.features.size()),
                       .sigma_s = params.sigma_s,
                       .slope_ridge = params.slope_ridge,
                       .reach = call.reach,
                       .pixel_divisor = 0,
                       .levels = params.height,
                       .pca_iterations = params.pca_iterations,
                       .cell = params.cell,
                       .keeps_mass = params.keeps_mass ? 1U : 0U,
                       .is_first_order = params.is_first_order ? 1U : 0U,
                       .has_points = 0,
                       .points_have_signals = 0,
                       .point_pixels = 0,
                       .samples = 0,
                       .own_features = 0};
  if (call.points == nullptr) return header;
  header.pixel_divisor = call.points->pixel_divisor;
  header.has_points = 1;
  header.points_have_signals = call.points->signals.empty() ? 0 : 1;
  header.point_pixels = static_cast<uint32_t>(call.points->pixels.size());
  header.samples = static_cast<uint32_t>(call.points->samples);
  header.own_features = static_cast<uint32_t>(call.points->own_features);
  return header;
}

bool ReceivePoints(const CallHeader& header, SocketStream* from, SlicePoints* points) {
  const size_t count = size_t{header.point_pixels} * header.samples;
  points->samples = header.samples;
  points->own_features = header.own_features;
  points->pixel_divisor = header.pixel_divisor;
  if (!ReceiveList(header.point_pixels, from, &points->pixels)) return false;
  for (const auto& [x, y] : points->pixels) {
    if (x < 0 || x >= header.width || y < 0 || y >= header.height) return false;
  }
  if (!ReceiveList(count * header.own_features, from, &points->features)) return false;
  if (header.points_have_signals == 0) return true;
  return ReceiveList(count * header.signals, from, &points->signals) &&
         ReceiveList(count, from, &points->weights);
}

}  // namespace

bool SendCall(const ManifoldCall& call, SocketStream* to) {
  const CallHeader header = HeaderOf(call);
  if (!IsValid(header) || !to->Write(&header, sizeof(header)) || !SendPlanes(call.signals, to) ||
      !SendPlanes(call.features, to) || !SendPlane(call.mask, to))
    return false;
  if (call.points == nullptr) return true;
  return SendList(call.points->pixels, to) && SendList(call.points->features, to) &&
         (header.points_have_signals == 0 ||
          (SendList(call.points->signals, to) && SendList(call.points->weights, to)));
}

std::optional<ReceivedCall> ReceiveCall(SocketStream* from) {
  CallHeader header = {};
  if (!from->Read(&header, sizeof(header)) || !IsValid(header)) return std::nullopt;
  ReceivedCall call;
  call.signals = MakeUninitializedPlanes(header.signals, header.width, header.height);
  call.features = MakeUninitializedPlanes(header.features, header.width, header.height);
  call.mask = Plane::Uninitialized(header.width, header.height);
  call.params = {.sigma_s = header.sigma_s,
                 .height = header.levels,
                 .pca_iterations = header.pca_iterations,
                 .cell = header.cell,
                 .keeps_mass = header.keeps_mass != 0,
                 .is_first_order = header.is_first_order != 0,
                 .slope_ridge = header.slope_ridge};
  call.reach = header.reach;
  if (!ReceivePlanes(from, &call.signals) || !ReceivePlanes(from, &call.features) ||
      !ReceivePlane(from, &call.mask))
    return std::nullopt;
  if (header.has_points == 0) return call;
  call.points.emplace();
  if (!ReceivePoints(header, from, &*call.points)) return std::nullopt;
  return call;
}

bool SendResult(const ManifoldResult& result, SocketStream* to) {
  return SendPlanes(result.filtered, to) && SendList(result.points.values, to) &&
         SendList(result.points.weights, to);
}

std::optional<ManifoldResult> ReceiveResult(const ManifoldCall& call, SocketStream* from) {
  ManifoldResult result;
  result.filtered = MakeUninitializedPlanes(call.signals.size(), call.mask.width(), call.mask.height());
  if (!ReceivePlanes(from, &result.filtered)) return std::nullopt;
  if (call.points == nullptr) return result;
  const size_t count = call.points->pixels.size() * call.points->samples;
  if (!ReceiveList(count * call.signals.size(), from, &result.points.values) ||
      !ReceiveList(count, from, &result.points.weights))
    return std::nullopt;
  return result;
}

}  // namespace lumifold::device
