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
constexpr int32_t kMostRadius = 64;
constexpr float kMostReach = 1 << 16;

/// The first word of a call.
constexpr uint32_t kFiltering = 1;
constexpr uint32_t kProjection = 2;

// Without padding: no byte of this process's memory goes with them.
struct PointsHeader {
  uint32_t is_here, has_signals;
  uint32_t count, own_features;
  float pixel_divisor;
};
struct CallHeader {
  uint32_t kind;
  int32_t width, height;
  uint32_t signals, features;
  float sigma_s, slope_ridge, reach;
  int32_t levels, pca_iterations, cell;
  uint32_t keeps_mass, is_first_order;
  PointsHeader points;
};
struct ProjectionHeader {
  uint32_t kind;
  int32_t width, height;
  uint32_t channels, dimensions;
  int32_t radius;
};

bool IsSize(int32_t width, int32_t height) {
  const auto is_side = [](int32_t side) { return side >= 1 && side <= kMostSide; };
  return is_side(width) && is_side(height) && int64_t{width} * height <= kMostPixels;
}
bool IsCount(uint32_t planes) { return planes >= 1 && planes <= kMostPlanes; }
bool IsPositive(float value, float most) { return value > 0 && value <= most; }

bool HasValidPoints(const CallHeader& header) {
  const PointsHeader& points = header.points;
  if (points.is_here == 0) return true;
  return points.own_features <= header.features && points.count <= kMostPoints / kMostPlanes &&
         std::isfinite(points.pixel_divisor);
}

bool IsValid(const CallHeader& header) {
  if (!IsSize(header.width, header.height) || !IsCount(header.features) || !IsCount(header.signals))
    return false;
  if (header.is_first_order != 0 && header.signals != 3) return false;
  if (header.levels < 1 || header.levels > 8) return false;
  if (header.pca_iterations < 1 || header.pca_iterations > 1000) return false;
  if (header.cell < 0 || header.cell > kBandRows || (header.cell & (header.cell - 1)) != 0) return false;
  return IsPositive(header.sigma_s, kMostReach) && IsPositive(header.reach, kMostReach) &&
         std::isfinite(header.slope_ridge) && HasValidPoints(header);
}

bool IsValid(const ProjectionHeader& header) {
  return IsSize(header.width, header.height) && IsCount(header.channels) && IsCount(header.dimensions) &&
         header.radius >= 0 && header.radius <= kMostRadius;
}

size_t TapsOf(const ProjectionHeader& header) {
  const size_t side = 2 * static_cast<size_t>(header.radius) + 1;
  return size_t{header.channels} * header.dimensions * side * side;
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
  CallHeader header = {};
  header.kind = kFiltering;
  header.width = call.mask.width();
  header.height = call.mask.height();
  header.signals = static_cast<uint32_t>(call.signals.size());
  header.features = static_cast<uint32_t>(call.features.size());
  header.sigma_s = params.sigma_s;
  header.slope_ridge = params.slope_ridge;
  header.reach = call.reach;
  header.levels = params.height;
  header.pca_iterations = params.pca_iterations;
  header.cell = params.cell;
  header.keeps_mass = params.keeps_mass ? 1 : 0;
  header.is_first_order = params.is_first_order ? 1 : 0;
  if (call.points == nullptr) return header;
  header.points = {.is_here = 1,
                   .has_signals = call.points->signals.empty() ? 0U : 1U,
                   .count = static_cast<uint32_t>(call.points->pixels.size()),
                   .own_features = static_cast<uint32_t>(call.points->own_features),
                   .pixel_divisor = call.points->pixel_divisor};
  return header;
}

ProjectionHeader HeaderOf(const filter::ProjectionCall& call) {
  return {.kind = kProjection,
          .width = call.color[0].width(),
          .height = call.color[0].height(),
          .channels = static_cast<uint32_t>(call.color.size()),
          .dimensions = static_cast<uint32_t>(call.dimensions),
          .radius = call.radius};
}

bool ReceivePoints(const CallHeader& header, SocketStream* from, SlicePoints* points) {
  const size_t count = header.points.count;
  points->own_features = header.points.own_features;
  points->pixel_divisor = header.points.pixel_divisor;
  if (!ReceiveList(count, from, &points->pixels)) return false;
  for (const auto& [x, y] : points->pixels) {
    if (x < 0 || x >= header.width || y < 0 || y >= header.height) return false;
  }
  if (!ReceiveList(count * header.points.own_features, from, &points->features)) return false;
  if (header.points.has_signals == 0) return true;
  return ReceiveList(count * header.signals, from, &points->signals) &&
         ReceiveList(count, from, &points->weights);
}

/// The rest of a header whose first word is here.
template <typename Header>
bool ReceiveHeader(SocketStream* from, Header* header) {
  return from->Read(&header->kind + 1, sizeof(*header) - sizeof(header->kind)) && IsValid(*header);
}

std::optional<AnyCall> ReceiveFiltering(SocketStream* from) {
  CallHeader header = {};
  if (!ReceiveHeader(from, &header)) return std::nullopt;
  ReceivedFiltering call;
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
  if (header.points.is_here == 0) return call;
  call.points.emplace();
  if (!ReceivePoints(header, from, &*call.points)) return std::nullopt;
  return call;
}

std::optional<AnyCall> ReceiveProjection(SocketStream* from) {
  ProjectionHeader header = {};
  if (!ReceiveHeader(from, &header)) return std::nullopt;
  ReceivedProjection call;
  call.color = MakeUninitializedPlanes(header.channels, header.width, header.height);
  call.radius = header.radius;
  call.dimensions = static_cast<int>(header.dimensions);
  if (!ReceivePlanes(from, &call.color) || !ReceiveList(TapsOf(header), from, &call.taps))
    return std::nullopt;
  return call;
}

}  // namespace

bool CanSend(const ManifoldCall& call) { return IsValid(HeaderOf(call)); }
bool CanSend(const filter::ProjectionCall& call) {
  const ProjectionHeader header = HeaderOf(call);
  return IsValid(header) && TapsOf(header) == call.taps.size();
}

bool SendCall(const ManifoldCall& call, SocketStream* to) {
  const CallHeader header = HeaderOf(call);
  if (!to->Write(&header, sizeof(header)) || !SendPlanes(call.signals, to) ||
      !SendPlanes(call.features, to) || !SendPlane(call.mask, to))
    return false;
  if (call.points == nullptr) return true;
  return SendList(call.points->pixels, to) && SendList(call.points->features, to) &&
         (header.points.has_signals == 0 ||
          (SendList(call.points->signals, to) && SendList(call.points->weights, to)));
}

bool SendCall(const filter::ProjectionCall& call, SocketStream* to) {
  const ProjectionHeader header = HeaderOf(call);
  return to->Write(&header, sizeof(header)) && SendPlanes(call.color, to) && SendList(call.taps, to);
}

std::optional<AnyCall> ReceiveCall(SocketStream* from) {
  uint32_t kind = 0;
  if (!from->Read(&kind, sizeof(kind))) return std::nullopt;
  if (kind == kFiltering) return ReceiveFiltering(from);
  if (kind == kProjection) return ReceiveProjection(from);
  return std::nullopt;
}

bool SendHasResult(bool has_result, SocketStream* to) {
  const uint32_t word = has_result ? 1 : 0;
  return to->Write(&word, sizeof(word));
}

std::optional<bool> ReceiveHasResult(SocketStream* from) {
  uint32_t word = 0;
  if (!from->Read(&word, sizeof(word))) return std::nullopt;
  return word != 0;
}

bool SendResult(const Planes& result, SocketStream* to) { return SendPlanes(result, to); }

bool SendResult(const ManifoldResult& result, SocketStream* to) {
  return SendPlanes(result.filtered, to) && SendList(result.points.values, to) &&
         SendList(result.points.weights, to);
}

std::optional<Planes> ReceiveResult(const filter::ProjectionCall& call, SocketStream* from) {
  Planes planes = MakeUninitializedPlanes(static_cast<size_t>(call.dimensions), call.color[0].width(),
                                          call.color[0].height());
  if (!ReceivePlanes(from, &planes)) return std::nullopt;
  return planes;
}

std::optional<ManifoldResult> ReceiveResult(const ManifoldCall& call, SocketStream* from) {
  ManifoldResult result;
  result.filtered = MakeUninitializedPlanes(call.signals.size(), call.mask.width(), call.mask.height());
  if (!ReceivePlanes(from, &result.filtered)) return std::nullopt;
  if (call.points == nullptr) return result;
  const size_t count = call.points->pixels.size();
  if (!ReceiveList(count * call.signals.size(), from, &result.points.values) ||
      !ReceiveList(count, from, &result.points.weights))
    return std::nullopt;
  return result;
}

}  // namespace lumifold::device
