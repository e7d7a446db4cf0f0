#include "proto/device/message_parts.h"

#include <cmath>
#include <utility>

namespace lumifold::device {
namespace {

using filter::SlicePoints;

constexpr uint32_t kMostPoints = 1U << 27;
constexpr float kMostReach = 1 << 16;

struct PointsHeader {
  uint32_t count, own_features, has_signals;
  uint32_t is_placed;  // as the first points of the message: they have the same pixels and features
  float pixel_divisor;
};

PointsHeader HeaderOf(const SlicePoints& points, const SlicePoints& first) {
  const bool is_placed = &points != &first && points.own_features == first.own_features &&
                         points.pixels == first.pixels && points.features == first.features;
  return {static_cast<uint32_t>(points.pixels.size()), static_cast<uint32_t>(points.own_features),
          points.signals.empty() ? 0U : 1U, is_placed ? 1U : 0U, points.pixel_divisor};
}

bool IsValid(const PointsHeader& header, const PointLimits& limits) {
  return header.own_features <= limits.features && header.count <= kMostPoints / kMostPlanes &&
         std::isfinite(header.pixel_divisor);
}

bool ReceivePlaces(const PointLimits& limits, size_t count, SocketStream* from, SlicePoints* points) {
  if (!ReceiveList(count, from, &points->pixels)) return false;
  for (const auto& [x, y] : points->pixels) {
    if (x < 0 || x >= limits.width || y < 0 || y >= limits.height) return false;
  }
  return ReceiveList(count * points->own_features, from, &points->features);
}

}  // namespace

ParamsHeader ParamsHeaderOf(const filter::ManifoldParams& params) {
  return {.sigma_s = params.sigma_s,
          .slope_ridge = params.slope_ridge,
          .levels = params.height,
          .pca_iterations = params.pca_iterations,
          .cell = params.cell,
          .keeps_mass = params.keeps_mass ? 1U : 0U,
          .is_first_order = params.is_first_order ? 1U : 0U};
}

filter::ManifoldParams ParamsOf(const ParamsHeader& header) {
  return {.sigma_s = header.sigma_s,
          .height = header.levels,
          .pca_iterations = header.pca_iterations,
          .cell = header.cell,
          .keeps_mass = header.keeps_mass != 0,
          .is_first_order = header.is_first_order != 0,
          .slope_ridge = header.slope_ridge};
}

bool IsValid(const ParamsHeader& header) {
  if (!IsTree(header.levels)) return false;
  if (header.pca_iterations < 1 || header.pca_iterations > 1000) return false;
  if (header.cell < 0 || header.cell > kBandRows || (header.cell & (header.cell - 1)) != 0) return false;
  return IsReach(header.sigma_s) && std::isfinite(header.slope_ridge);
}

bool IsTree(int32_t levels) { return levels >= 1 && levels <= 8; }

bool IsReach(float reach) { return IsPositive(reach, kMostReach); }

bool CanSend(const SlicePoints& points, const PointLimits& limits) {
  return IsValid(HeaderOf(points, points), limits);
}

bool SendPoints(const SlicePoints& points, const SlicePoints& first, SocketStream* to) {
  const PointsHeader header = HeaderOf(points, first);
  if (!to->Write(&header, sizeof(header))) return false;
  if (header.is_placed == 0 && !(SendList(points.pixels, to) && SendList(points.features, to))) return false;
  return header.has_signals == 0 || (SendList(points.signals, to) && SendList(points.weights, to));
}

bool ReceivePoints(const PointLimits& limits, SocketStream* from, std::vector<SlicePoints>* all) {
  PointsHeader header = {};
  if (!from->Read(&header, sizeof(header)) || !IsValid(header, limits)) return false;
  SlicePoints points;
  if (header.is_placed != 0) {
    if (all->empty() || all->front().pixels.size() != header.count ||
        all->front().own_features != header.own_features)
      return false;
    points.pixels = all->front().pixels;
    points.features = all->front().features;
  }
  points.own_features = header.own_features;
  points.pixel_divisor = header.pixel_divisor;
  if (header.is_placed == 0 && !ReceivePlaces(limits, header.count, from, &points)) return false;
  if (header.has_signals != 0 &&
      !(ReceiveList(size_t{header.count} * limits.signals, from, &points.signals) &&
        ReceiveList(header.count, from, &points.weights)))
    return false;
  all->push_back(std::move(points));
  return true;
}

bool SendPlanes(const filter::PlaneViews& planes, SocketStream* to) {
  bool works = true;
  for (const ConstFloatView& plane : planes) works = works && to->WriteRows(plane);
  return works;
}

bool ReceivePlanes(const PlaneCount& planes, SocketStream* from, Planes* received) {
  // One by one: a header alone makes no memory.
  for (size_t i = 0; i < planes.count; ++i) {
    received->push_back(Plane::Uninitialized(planes.width, planes.height));
    if (!from->ReadRows(received->back().view())) return false;
  }
  return true;
}

}  // namespace lumifold::device
