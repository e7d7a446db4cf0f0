#include "proto/device/call_messages.h"

#include <cmath>
#include <cstdint>
#include <vector>

#include "filter/image/planes.h"
#include "proto/device/message_parts.h"

namespace lumifold::device {
namespace {

using filter::ManifoldCall;
using filter::ManifoldResult;

// Without padding, as message_parts.h says.
struct PatchesHeader {
  int32_t radius, dimensions;
  float scale;
};
struct Header {
  int32_t width, height;
  uint32_t signals, colors, features, has_points;
  PatchesHeader patches;
  float reach;
  ParamsHeader params;
};

uint32_t PlanesOf(const Header& header) { return header.signals + header.colors + header.features + 1; }

bool HasValidPatches(const Header& header) {
  if (header.patches.dimensions == 0) return header.colors <= kMostPlanes && header.features >= 1;
  return header.patches.dimensions > 0 &&
         IsCount(static_cast<uint32_t>(header.patches.dimensions) + header.features) &&
         IsCount(header.colors) && header.patches.radius >= 0 && header.patches.radius <= kMostRadius;
}

bool IsValid(const Header& header) {
  if (!IsSize(header.width, header.height) || !IsCount(header.signals) || header.features > kMostPlanes)
    return false;
  if (!HasValidPatches(header) || !std::isfinite(header.patches.scale)) return false;
  return IsReach(header.reach) && IsValid(header.params) &&
         (header.params.is_first_order == 0 || header.signals == 3);
}

size_t TapsOf(const Header& header) {
  if (header.patches.dimensions == 0) return 0;
  const size_t side = 2 * static_cast<size_t>(header.patches.radius) + 1;
  return size_t{header.colors} * static_cast<size_t>(header.patches.dimensions) * side * side;
}

/// All planes of a call, in the order in which they are sent.
filter::PlaneViews PlanesOf(const ManifoldCall& call) {
  filter::PlaneViews planes = call.signals;
  planes.insert(planes.end(), call.patches.color.begin(), call.patches.color.end());
  planes.insert(planes.end(), call.features.begin(), call.features.end());
  planes.push_back(call.mask);
  return planes;
}

Header HeaderOf(const ManifoldCall& call) {
  return {.width = call.mask.width(),
          .height = call.mask.height(),
          .signals = static_cast<uint32_t>(call.signals.size()),
          .colors = static_cast<uint32_t>(call.patches.color.size()),
          .features = static_cast<uint32_t>(call.features.size()),
          .has_points = call.points != nullptr ? 1U : 0U,
          .patches = {call.patches.radius, call.patches.dimensions, call.patches.scale},
          .reach = call.reach,
          .params = ParamsHeaderOf(call.params)};
}

PointLimits LimitsOf(const Header& header) {
  return {header.width, header.height, static_cast<uint32_t>(header.patches.dimensions) + header.features,
          header.signals};
}

}  // namespace

ManifoldCall ReceivedCall::View() const {
  const auto views_of = [&](size_t first, size_t end) {
    filter::PlaneViews found;
    for (size_t i = first; i < end; ++i) found.push_back(planes[i].view());
    return found;
  };
  return {views_of(0, signals),
          {views_of(signals, signals + colors), radius, dimensions, taps, scale},
          views_of(signals + colors, planes.size() - 1),
          planes.back().view(),
          params,
          reach,
          points.empty() ? nullptr : &points.front()};
}

bool CanSend(const ManifoldCall& call) {
  const Header header = HeaderOf(call);
  return IsValid(header) && TapsOf(header) == call.patches.taps.size() &&
         (call.points == nullptr || CanSend(*call.points, LimitsOf(header)));
}

bool SendCall(const ManifoldCall& call, SocketStream* to) {
  const Header header = HeaderOf(call);
  return SendOperation(Operation::kFilter, to) && to->Write(&header, sizeof(header)) &&
         SendPlanes(PlanesOf(call), to) && SendList(call.patches.taps, to) &&
         (call.points == nullptr || SendPoints(*call.points, *call.points, to));
}

std::optional<ReceivedCall> ReceiveCall(SocketStream* from) {
  Header header = {};
  if (!from->Read(&header, sizeof(header)) || !IsValid(header)) return std::nullopt;
  ReceivedCall call;
  call.params = ParamsOf(header.params);
  call.reach = header.reach;
  call.signals = header.signals;
  call.colors = header.colors;
  call.radius = header.patches.radius;
  call.dimensions = header.patches.dimensions;
  call.scale = header.patches.scale;
  if (!ReceivePlanes({PlanesOf(header), header.width, header.height}, from, &call.planes) ||
      !ReceiveList(TapsOf(header), from, &call.taps) ||
      (header.has_points != 0 && !ReceivePoints(LimitsOf(header), from, &call.points)))
    return std::nullopt;
  return call;
}

std::optional<Operation> ReceiveOperation(SocketStream* from) {
  Operation operation = {};
  if (!from->Read(&operation, sizeof(operation)) || operation > Operation::kLayer) return std::nullopt;
  return operation;
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

bool SendResult(const ManifoldResult& result, SocketStream* to) {
  return SendPlanes(filter::ViewsOf(result.filtered), to) && SendList(result.points.values, to) &&
         SendList(result.points.weights, to);
}

std::optional<ManifoldResult> ReceiveResult(const ManifoldCall& call, SocketStream* from) {
  ManifoldResult result;
  const PlaneCount planes = {call.signals.size(), call.mask.width(), call.mask.height()};
  const size_t points = call.points != nullptr ? call.points->pixels.size() : 0;
  if (!ReceivePlanes(planes, from, &result.filtered) ||
      !ReceiveList(points * call.signals.size(), from, &result.points.values) ||
      !ReceiveList(points, from, &result.points.weights))
    return std::nullopt;
  return result;
}

}  // namespace lumifold::device
