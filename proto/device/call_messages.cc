#include "proto/device/call_messages.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "filter/image/planes.h"
#include "filter/manifold/first_order.h"
#include "proto/device/message_parts.h"

namespace lumifold::device {
namespace {

using filter::ManifoldCall;
using filter::ManifoldResult;
using filter::SlicePoints;

// Far above what our methods ask for; see message_parts.h.
constexpr uint32_t kMostCalls = 16;

// Without padding, as message_parts.h says. What all calls have in common:
struct PatchesHeader {
  int32_t radius, dimensions;
};
struct Header {
  int32_t width, height;
  uint32_t planes, calls;  // planes that differ
  uint32_t points;         // that differ
  uint32_t signals, colors, features;
  PatchesHeader patches;
  float reach;
  ParamsHeader params;
};
struct PartHeader {
  float scale;
  uint32_t points;  // which of the message, from 1; 0: none
};

/// Planes of one call.
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
  if (header.calls < 1 || header.calls > kMostCalls || header.points > header.calls) return false;
  if (!HasValidPatches(header) || header.planes > header.calls * PlanesOf(header)) return false;
  return IsReach(header.reach) && IsValid(header.params) &&
         (header.params.is_first_order == 0 || header.signals == 3);
}

bool IsValid(const PartHeader& part, const Header& header) {
  return std::isfinite(part.scale) && part.points <= header.points;
}

size_t TapsOf(const Header& header) {
  if (header.patches.dimensions == 0) return 0;
  const size_t side = 2 * static_cast<size_t>(header.patches.radius) + 1;
  return size_t{header.colors} * static_cast<size_t>(header.patches.dimensions) * side * side;
}

/// All planes of a call, in the order of ReceivedCalls::Part::planes.
filter::PlaneViews PlanesOf(const ManifoldCall& call) {
  filter::PlaneViews planes = call.signals;
  planes.insert(planes.end(), call.patches.color.begin(), call.patches.color.end());
  planes.insert(planes.end(), call.features.begin(), call.features.end());
  planes.push_back(call.mask);
  return planes;
}

/// The planes of calls, each once, and their numbers; the first pixel tells a plane from others. And points.
struct CallTable {
  explicit CallTable(absl::Span<const ManifoldCall> calls) {
    const auto add = [&](const ConstFloatView& plane) {
      if (numbers.emplace(plane.Row(0), static_cast<uint32_t>(planes.size())).second) planes.push_back(plane);
    };
    for (const ManifoldCall& call : calls) {
      for (const ConstFloatView& plane : PlanesOf(call)) add(plane);
      if (call.points != nullptr && std::find(points.begin(), points.end(), call.points) == points.end())
        points.push_back(call.points);
    }
  }

  filter::PlaneViews planes;
  std::map<const float*, uint32_t> numbers;
  std::vector<const SlicePoints*> points;
};

Header HeaderOf(absl::Span<const ManifoldCall> calls, const CallTable& table) {
  const ManifoldCall& call = calls.front();
  return {.width = call.mask.width(),
          .height = call.mask.height(),
          .planes = static_cast<uint32_t>(table.planes.size()),
          .calls = static_cast<uint32_t>(calls.size()),
          .points = static_cast<uint32_t>(table.points.size()),
          .signals = static_cast<uint32_t>(call.signals.size()),
          .colors = static_cast<uint32_t>(call.patches.color.size()),
          .features = static_cast<uint32_t>(call.features.size()),
          .patches = {.radius = call.patches.radius, .dimensions = call.patches.dimensions},
          .reach = call.reach,
          .params = ParamsHeaderOf(call.params)};
}

PointLimits LimitsOf(const Header& header) {
  return {header.width, header.height, static_cast<uint32_t>(header.patches.dimensions) + header.features,
          header.signals};
}

PartHeader PartOf(const ManifoldCall& call, const CallTable& table) {
  const auto found = std::find(table.points.begin(), table.points.end(), call.points);
  return {call.patches.scale,
          call.points == nullptr ? 0 : static_cast<uint32_t>(found - table.points.begin()) + 1};
}

bool SendPart(const ManifoldCall& call, const CallTable& table, SocketStream* to) {
  const PartHeader part = PartOf(call, table);
  std::vector<uint32_t> numbers;
  for (const ConstFloatView& plane : PlanesOf(call)) numbers.push_back(table.numbers.at(plane.Row(0)));
  return to->Write(&part, sizeof(part)) && SendList(numbers, to) && SendList(call.patches.taps, to);
}

bool ReceivePart(const Header& header, SocketStream* from, ReceivedCalls::Part* part) {
  PartHeader head = {};
  if (!from->Read(&head, sizeof(head)) || !IsValid(head, header)) return false;
  part->scale = head.scale;
  if (!ReceiveList(PlanesOf(header), from, &part->planes) || !ReceiveList(TapsOf(header), from, &part->taps))
    return false;
  for (const uint32_t number : part->planes) {
    if (number >= header.planes) return false;
  }
  part->points = head.points;
  return true;
}

bool ReceiveResult(const ManifoldCall& call, SocketStream* from, ManifoldResult* result) {
  const PlaneCount planes = {call.signals.size(), call.mask.width(), call.mask.height()};
  if (!ReceivePlanes(planes, from, &result->filtered)) return false;
  if (call.points == nullptr) return true;
  const size_t count = call.points->pixels.size();
  return ReceiveList(count * call.signals.size(), from, &result->points.values) &&
         ReceiveList(count, from, &result->points.weights);
}

}  // namespace

std::vector<ManifoldCall> ReceivedCalls::View() const {
  std::vector<ManifoldCall> calls;
  for (const Part& part : parts) {
    const auto views_of = [&](size_t first, size_t end) {
      filter::PlaneViews found;
      for (size_t i = first; i < end; ++i) found.push_back(planes[part.planes[i]].view());
      return found;
    };
    const size_t mask = part.planes.size() - 1;
    const size_t patches = signals + colors;
    calls.push_back({views_of(0, signals),
                     {views_of(signals, patches), radius, dimensions, part.taps, part.scale},
                     views_of(patches, mask),
                     planes[part.planes[mask]].view(),
                     params,
                     reach,
                     part.points > 0 ? &points[part.points - 1] : nullptr});
  }
  return calls;
}

bool CanSend(absl::Span<const ManifoldCall> calls) {
  if (calls.empty() || calls.size() > kMostCalls) return false;
  const CallTable table(calls);
  const Header header = HeaderOf(calls, table);
  return IsValid(header) && std::all_of(calls.begin(), calls.end(), [&](const ManifoldCall& call) {
           return IsValid(PartOf(call, table), header) && TapsOf(header) == call.patches.taps.size() &&
                  (call.points == nullptr || CanSend(*call.points, LimitsOf(header)));
         });
}

bool SendCalls(absl::Span<const ManifoldCall> calls, SocketStream* to) {
  const CallTable table(calls);
  const Header header = HeaderOf(calls, table);
  bool works = SendOperation(Operation::kFilter, to) && to->Write(&header, sizeof(header)) &&
               SendPlanes(table.planes, to);
  for (const SlicePoints* points : table.points) works = works && SendPoints(*points, *table.points[0], to);
  for (const ManifoldCall& call : calls) works = works && SendPart(call, table, to);
  return works;
}

std::optional<ReceivedCalls> ReceiveCalls(SocketStream* from) {
  Header header = {};
  if (!from->Read(&header, sizeof(header)) || !IsValid(header)) return std::nullopt;
  ReceivedCalls calls;
  if (!ReceivePlanes({header.planes, header.width, header.height}, from, &calls.planes)) return std::nullopt;
  calls.params = ParamsOf(header.params);
  calls.reach = header.reach;
  calls.signals = header.signals;
  calls.colors = header.colors;
  calls.radius = header.patches.radius;
  calls.dimensions = header.patches.dimensions;
  bool works = true;
  for (uint32_t i = 0; i < header.points; ++i)
    works = works && ReceivePoints(LimitsOf(header), from, &calls.points);
  calls.parts.resize(header.calls);
  for (ReceivedCalls::Part& part : calls.parts) works = works && ReceivePart(header, from, &part);
  if (!works) return std::nullopt;
  return calls;
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

bool SendResults(const std::vector<ManifoldResult>& results, SocketStream* to) {
  bool works = true;
  for (const ManifoldResult& result : results)
    works = works && SendPlanes(filter::ViewsOf(result.filtered), to) && SendList(result.points.values, to) &&
            SendList(result.points.weights, to);
  return works;
}

std::optional<std::vector<ManifoldResult>> ReceiveResults(absl::Span<const ManifoldCall> calls,
                                                          SocketStream* from) {
  std::vector<ManifoldResult> results(calls.size());
  for (size_t i = 0; i < calls.size(); ++i) {
    if (!ReceiveResult(calls[i], from, &results[i])) return std::nullopt;
  }
  return results;
}

}  // namespace lumifold::device
