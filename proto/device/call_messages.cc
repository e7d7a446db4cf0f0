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
constexpr uint32_t kMostKept = 256;
constexpr uint64_t kMostKeptFloats = uint64_t{1} << 27;
constexpr uint32_t kIsThere = uint32_t{1} << 31;  // beside the number of a plane
constexpr uint32_t kNone = UINT32_MAX;            // in place of the number of a plane
constexpr uint32_t kMostPoints = 1U << 27;
constexpr float kMostReach = 1 << 16;

// Without padding: no byte of this process's memory goes with them. What all calls have in common:
struct ParamsHeader {
  float sigma_s, slope_ridge, reach;
  int32_t levels, pca_iterations, cell;
  uint32_t keeps_mass, is_first_order;
};
struct PatchesHeader {
  int32_t radius, dimensions;
  float inverse_knee, shift;
};
struct Header {
  int32_t width, height;
  uint32_t planes, calls;  // planes that differ
  uint32_t forgotten;      // planes
  uint32_t others;         // beside those of the calls; some may be empty
  uint32_t points;         // that differ
  uint32_t signals, bases, colors, features;
  PatchesHeader patches;
  ParamsHeader params;
};
struct PointsHeader {
  uint32_t count, own_features, has_signals;
  uint32_t is_placed;  // as the first points of the message: they have the same pixels and features
  float pixel_divisor;
};
struct PartHeader {
  float scale;
  uint32_t points;  // which of the message, from 1; 0: none
};

/// Planes of one call.
uint32_t PlanesOf(const Header& header) {
  return header.signals + header.bases + header.colors + header.features + 1;
}

uint64_t FloatsOf(const ConstFloatView& plane) {
  return static_cast<uint64_t>(plane.width()) * static_cast<uint64_t>(plane.height());
}

bool HasValidPatches(const Header& header) {
  if (header.patches.dimensions == 0) return header.colors <= kMostPlanes && header.features >= 1;
  return header.patches.dimensions > 0 &&
         IsCount(static_cast<uint32_t>(header.patches.dimensions) + header.features) &&
         IsCount(header.colors) && header.patches.radius >= 0 && header.patches.radius <= kMostRadius;
}

bool IsValid(const ParamsHeader& params) {
  if (params.levels < 1 || params.levels > 8) return false;
  if (params.pca_iterations < 1 || params.pca_iterations > 1000) return false;
  if (params.cell < 0 || params.cell > kBandRows || (params.cell & (params.cell - 1)) != 0) return false;
  return IsPositive(params.sigma_s, kMostReach) && IsPositive(params.reach, kMostReach) &&
         std::isfinite(params.slope_ridge);
}

bool IsValid(const Header& header) {
  if (!IsSize(header.width, header.height) || !IsCount(header.signals) || header.features > kMostPlanes)
    return false;
  if (header.calls < 1 || header.calls > kMostCalls || header.forgotten > kMostKept) return false;
  if (header.others > kMostPlanes) return false;
  if (header.points > header.calls) return false;
  if (header.bases != 0 && header.bases != header.signals) return false;
  if (!std::isfinite(header.patches.inverse_knee) || !std::isfinite(header.patches.shift)) return false;
  if (!HasValidPatches(header) || header.planes > header.calls * PlanesOf(header) + header.others)
    return false;
  return IsValid(header.params) && (header.params.is_first_order == 0 || header.signals == 3);
}

bool IsValid(const PartHeader& part, const Header& header) {
  return std::isfinite(part.scale) && part.points <= header.points;
}

bool IsValid(const PointsHeader& part, const Header& header) {
  return part.own_features <= static_cast<uint32_t>(header.patches.dimensions) + header.features &&
         part.count <= kMostPoints / kMostPlanes && std::isfinite(part.pixel_divisor);
}

size_t TapsOf(const Header& header) {
  if (header.patches.dimensions == 0) return 0;
  const size_t side = 2 * static_cast<size_t>(header.patches.radius) + 1;
  return size_t{header.colors} * static_cast<size_t>(header.patches.dimensions) * side * side;
}

/// All planes of a call, in the order of ReceivedCalls::Part::planes.
filter::PlaneViews PlanesOf(const ManifoldCall& call) {
  filter::PlaneViews planes = call.signals;
  planes.insert(planes.end(), call.bases.begin(), call.bases.end());
  planes.insert(planes.end(), call.patches.color.begin(), call.patches.color.end());
  planes.insert(planes.end(), call.features.begin(), call.features.end());
  planes.push_back(call.mask);
  return planes;
}

/// The planes of calls, each once, and their numbers; the first pixel tells a plane from others. And points.
struct CallTable {
  explicit CallTable(absl::Span<const ManifoldCall> calls, const filter::PlaneViews& others = {}) {
    const auto add = [&](const ConstFloatView& plane) {
      if (numbers.emplace(plane.Row(0), static_cast<uint32_t>(planes.size())).second) planes.push_back(plane);
    };
    for (const ConstFloatView& plane : others) {
      if (!plane.IsEmpty()) add(plane);
    }
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
  const filter::ManifoldParams& params = call.params;
  return {.width = call.mask.width(),
          .height = call.mask.height(),
          .planes = static_cast<uint32_t>(table.planes.size()),
          .calls = static_cast<uint32_t>(calls.size()),
          .forgotten = 0,
          .others = 0,
          .points = static_cast<uint32_t>(table.points.size()),
          .signals = static_cast<uint32_t>(call.signals.size()),
          .bases = static_cast<uint32_t>(call.bases.size()),
          .colors = static_cast<uint32_t>(call.patches.color.size()),
          .features = static_cast<uint32_t>(call.features.size()),
          .patches = {.radius = call.patches.radius,
                      .dimensions = call.patches.dimensions,
                      .inverse_knee = call.patches.inverse_knee,
                      .shift = call.patches.shift},
          .params = {.sigma_s = params.sigma_s,
                     .slope_ridge = params.slope_ridge,
                     .reach = call.reach,
                     .levels = params.height,
                     .pca_iterations = params.pca_iterations,
                     .cell = params.cell,
                     .keeps_mass = params.keeps_mass ? 1U : 0U,
                     .is_first_order = params.is_first_order ? 1U : 0U}};
}

PartHeader PartOf(const ManifoldCall& call, const CallTable& table) {
  const auto found = std::find(table.points.begin(), table.points.end(), call.points);
  return {call.patches.scale,
          call.points == nullptr ? 0 : static_cast<uint32_t>(found - table.points.begin()) + 1};
}

PointsHeader HeaderOf(const SlicePoints& points, const SlicePoints& first) {
  const bool is_placed = &points != &first && points.own_features == first.own_features &&
                         points.pixels == first.pixels && points.features == first.features;
  return {static_cast<uint32_t>(points.pixels.size()), static_cast<uint32_t>(points.own_features),
          points.signals.empty() ? 0U : 1U, is_placed ? 1U : 0U, points.pixel_divisor};
}

bool SendPoints(const SlicePoints& points, const SlicePoints& first, SocketStream* to) {
  const PointsHeader header = HeaderOf(points, first);
  if (!to->Write(&header, sizeof(header))) return false;
  if (header.is_placed == 0 && !(SendList(points.pixels, to) && SendList(points.features, to))) return false;
  return header.has_signals == 0 || (SendList(points.signals, to) && SendList(points.weights, to));
}

bool SendPart(const ManifoldCall& call, const CallTable& table, SocketStream* to) {
  const PartHeader part = PartOf(call, table);
  std::vector<uint32_t> numbers;
  for (const ConstFloatView& plane : PlanesOf(call)) numbers.push_back(table.numbers.at(plane.Row(0)));
  return to->Write(&part, sizeof(part)) && SendList(numbers, to) && SendList(call.patches.taps, to);
}

bool ReceivePlaces(const Header& header, size_t count, SocketStream* from, SlicePoints* points) {
  if (!ReceiveList(count, from, &points->pixels)) return false;
  for (const auto& [x, y] : points->pixels) {
    if (x < 0 || x >= header.width || y < 0 || y >= header.height) return false;
  }
  return ReceiveList(count * points->own_features, from, &points->features);
}

bool ReceivePoints(const Header& header, SocketStream* from, std::vector<SlicePoints>* all) {
  PointsHeader head = {};
  if (!from->Read(&head, sizeof(head)) || !IsValid(head, header)) return false;
  SlicePoints points;
  if (head.is_placed != 0) {
    if (all->empty() || all->front().pixels.size() != head.count ||
        all->front().own_features != head.own_features)
      return false;
    points.pixels = all->front().pixels;
    points.features = all->front().features;
  }
  points.own_features = head.own_features;
  points.pixel_divisor = head.pixel_divisor;
  if (head.is_placed == 0 && !ReceivePlaces(header, head.count, from, &points)) return false;
  if (head.has_signals != 0 && !(ReceiveList(size_t{head.count} * header.signals, from, &points.signals) &&
                                 ReceiveList(head.count, from, &points.weights)))
    return false;
  all->push_back(std::move(points));
  return true;
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

/// A plane of calls, and its view: kept, to be kept, or theirs alone.
bool ReceivePlane(const Header& header, uint32_t word, KeptPlanesOfCaller* kept, SocketStream* from,
                  ReceivedCalls* calls) {
  const uint32_t number = word & ~kIsThere;
  const auto found = kept->find(number);
  if ((word & kIsThere) != 0) {
    if (found == kept->end()) return false;
    calls->views.push_back(found->second.view());
    return found->second.width() == header.width && found->second.height() == header.height;
  }
  Plane plane = Plane::Uninitialized(header.width, header.height);
  if (!from->ReadRows(plane.view())) return false;
  if (number == 0) {
    calls->views.push_back(calls->planes.emplace_back(std::move(plane)).view());
    return true;
  }
  uint64_t floats = FloatsOf(plane.view());
  for (const auto& [_, other] : *kept) floats += FloatsOf(other.view());
  if (found != kept->end() || kept->size() >= kMostKept || floats > kMostKeptFloats) return false;
  calls->views.push_back(kept->emplace(number, std::move(plane)).first->second.view());
  return true;
}

bool ReceivePlanes(const Header& header, KeptPlanesOfCaller* kept, SocketStream* from, ReceivedCalls* calls) {
  std::vector<uint32_t> forgotten, words, others;
  if (!ReceiveList(header.forgotten, from, &forgotten) || !ReceiveList(header.planes, from, &words) ||
      !ReceiveList(header.others, from, &others))
    return false;
  for (const uint32_t number : forgotten) kept->erase(number);
  if (!std::all_of(words.begin(), words.end(),
                   [&](uint32_t word) { return ReceivePlane(header, word, kept, from, calls); }))
    return false;
  for (const uint32_t number : others) {
    if (number != kNone && number >= header.planes) return false;
    calls->others.push_back(number == kNone ? ConstFloatView{} : calls->views[number]);
  }
  return true;
}

bool ReceiveResult(const ManifoldCall& call, SocketStream* from, ManifoldResult* result) {
  result->filtered = MakeUninitializedPlanes(call.signals.size(), call.mask.width(), call.mask.height());
  if (!ReceivePlanes(from, &result->filtered)) return false;
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
      for (size_t i = first; i < end; ++i) found.push_back(views[part.planes[i]]);
      return found;
    };
    const size_t mask = part.planes.size() - 1;
    const size_t patches = signals + bases;
    calls.push_back({views_of(0, signals),
                     views_of(signals, patches),
                     {views_of(patches, patches + colors), radius, dimensions, part.taps, part.scale,
                      inverse_knee, shift},
                     views_of(patches + colors, mask),
                     views[part.planes[mask]],
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
                  (call.points == nullptr || IsValid(HeaderOf(*call.points, *call.points), header));
         });
}

void SentPlanes::Keep(absl::Span<const ConstFloatView> planes) {
  for (const ConstFloatView& plane : planes) {
    const uint64_t floats = FloatsOf(plane);
    if (floats == 0 || kept_.size() + forgotten_.size() >= kMostKept || floats_ + floats > kMostKeptFloats)
      continue;
    if (kept_.emplace(plane.Row(0), Kept{last_ % (kIsThere - 1) + 1, floats, false}).second) {
      ++last_;
      floats_ += floats;
    }
  }
}

void SentPlanes::Forget(absl::Span<const ConstFloatView> planes) {
  for (const ConstFloatView& plane : planes) {
    const auto found = FloatsOf(plane) > 0 ? kept_.find(plane.Row(0)) : kept_.end();
    if (found == kept_.end()) continue;
    if (found->second.is_there) forgotten_.push_back(found->second.number);
    floats_ -= found->second.floats;
    kept_.erase(found);
  }
}

uint32_t SentPlanes::NumberOf(const ConstFloatView& plane, bool* is_there) const {
  const auto found = kept_.find(plane.Row(0));
  *is_there = found != kept_.end() && found->second.is_there;
  return found != kept_.end() ? found->second.number : 0;
}

void SentPlanes::SetSent(absl::Span<const ConstFloatView> planes) {
  for (const ConstFloatView& plane : planes) {
    if (const auto found = kept_.find(plane.Row(0)); found != kept_.end()) found->second.is_there = true;
  }
}

bool SendCalls(absl::Span<const ManifoldCall> calls, SentPlanes* kept, SocketStream* to) {
  return SendOperation(Operation::kFilter, to) && SendCallsAnd({}, calls, kept, to);
}

bool SendCallsAnd(const filter::PlaneViews& others, absl::Span<const ManifoldCall> calls, SentPlanes* kept,
                  SocketStream* to) {
  const CallTable table(calls, others);
  Header header = HeaderOf(calls, table);
  header.others = static_cast<uint32_t>(others.size());
  std::vector<uint32_t> numbers;
  for (const ConstFloatView& plane : others)
    numbers.push_back(plane.IsEmpty() ? kNone : table.numbers.at(plane.Row(0)));
  const std::vector<uint32_t> forgotten = kept->TakeForgotten();
  header.forgotten = static_cast<uint32_t>(forgotten.size());
  std::vector<uint32_t> words;
  filter::PlaneViews sent;
  for (const ConstFloatView& plane : table.planes) {
    bool is_there = false;
    words.push_back(kept->NumberOf(plane, &is_there));
    if (is_there)
      words.back() |= kIsThere;
    else
      sent.push_back(plane);
  }
  bool works = to->Write(&header, sizeof(header)) && SendList(forgotten, to) && SendList(words, to) &&
               SendList(numbers, to);
  for (const ConstFloatView& plane : sent) works = works && to->WriteRows(plane);
  kept->SetSent(sent);
  for (const SlicePoints* points : table.points) works = works && SendPoints(*points, *table.points[0], to);
  for (const ManifoldCall& call : calls) works = works && SendPart(call, table, to);
  return works;
}

std::optional<ReceivedCalls> ReceiveCalls(KeptPlanesOfCaller* kept, SocketStream* from) {
  Header header = {};
  if (!from->Read(&header, sizeof(header)) || !IsValid(header)) return std::nullopt;
  ReceivedCalls calls;
  if (!ReceivePlanes(header, kept, from, &calls)) return std::nullopt;
  const ParamsHeader& params = header.params;
  calls.params = {.sigma_s = params.sigma_s,
                  .height = params.levels,
                  .pca_iterations = params.pca_iterations,
                  .cell = params.cell,
                  .keeps_mass = params.keeps_mass != 0,
                  .is_first_order = params.is_first_order != 0,
                  .slope_ridge = params.slope_ridge};
  calls.reach = params.reach;
  calls.signals = header.signals;
  calls.bases = header.bases;
  calls.colors = header.colors;
  calls.radius = header.patches.radius;
  calls.dimensions = header.patches.dimensions;
  calls.inverse_knee = header.patches.inverse_knee;
  calls.shift = header.patches.shift;
  bool works = true;
  for (uint32_t i = 0; i < header.points; ++i) works = works && ReceivePoints(header, from, &calls.points);
  calls.parts.resize(header.calls);
  for (ReceivedCalls::Part& part : calls.parts) works = works && ReceivePart(header, from, &part);
  if (!works) return std::nullopt;
  return calls;
}

std::optional<Operation> ReceiveOperation(SocketStream* from) {
  Operation operation = {};
  if (!from->Read(&operation, sizeof(operation)) || operation > Operation::kRefine) return std::nullopt;
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
    works = works && SendPlanes(result.filtered, to) && SendList(result.points.values, to) &&
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
