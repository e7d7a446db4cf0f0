#include "proto/device/refine_messages.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "proto/device/message_parts.h"

namespace lumifold::device {
namespace {

using filter::ManifoldCall;
using filter::RefineCall;

constexpr float kMostSigma = 40;  // of fits, pixels: windows are within kMostRadius

/// Without padding.
struct RefineHeader {
  int32_t widest_radius, wide_radius, narrow_radius, blend_radius;
  float significance, dim, level;
  uint32_t fits;
  float sigma_px, sigma_light, slope, knee;  // of the fit
};

RefineHeader HeaderOf(const RefineCall& call) {
  const filter::ChoiceParams& choice = call.choice;
  const filter::LightFit fit = call.fit.value_or(filter::LightFit{});
  return {choice.widest_radius, choice.wide_radius,
          choice.narrow_radius, choice.blend_radius,
          choice.significance,  choice.dim,
          call.level,           call.fit.has_value() ? 1U : 0U,
          fit.params.sigma_px,  fit.params.sigma_light,
          fit.params.slope,     fit.knee};
}

bool IsValid(const RefineHeader& header) {
  // Wide windows are cut at the picture, narrow ones are summed pixel by pixel.
  const auto is_radius = [](int32_t radius, int32_t most) { return radius >= 0 && radius <= most; };
  return is_radius(header.widest_radius, kMostSide) && is_radius(header.wide_radius, kMostSide) &&
         is_radius(header.narrow_radius, kMostRadius) && is_radius(header.blend_radius, kMostRadius) &&
         std::isfinite(header.significance) && std::isfinite(header.dim) && std::isfinite(header.level) &&
         IsPositive(header.sigma_px, kMostSigma) && std::isfinite(header.sigma_light) &&
         std::isfinite(header.slope) && std::isfinite(header.knee);
}

size_t PointsOf(absl::Span<const ManifoldCall> calls) {
  return calls.front().points != nullptr ? calls.front().points->pixels.size() : 0;
}

/// Whether the filterings are those of two halves of a layer, all with as many points.
bool HasHalves(absl::Span<const ManifoldCall> calls) {
  const size_t points = PointsOf(calls);
  return calls.size() % 2 == 0 && std::all_of(calls.begin(), calls.end(), [&](const ManifoldCall& call) {
           if (call.signals.size() != 3 || call.bases.size() != 3) return false;
           if (call.points == nullptr) return points == 0;
           if (call.points->own_features > call.features.size()) return false;
           return call.points->pixels.size() == points && call.points->weights.size() == points &&
                  call.points->signals.size() == 3 * points;
         });
}

/// All lists of points, with the numbers of floats that a point has.
template <typename Call, typename Use>
bool ForEachList(Call& call, const Use& use) {
  bool works = true;
  for (size_t h = 0; h < 2; ++h)
    works = works && use(call.noisy[h], 3) && use(call.base[h], 3) && use(call.coverage[h], 1);
  return works && use(call.offsets, 2) && use(call.point_weights, 1) && use(call.point_samples, 1);
}

}  // namespace

RefineCall ReceivedRefinement::View(absl::Span<const ManifoldCall> calls) const {
  RefineCall view = call;
  view.filterings = calls;
  const filter::PlaneViews& planes = filterings.others;
  view.weight = planes[0];
  view.samples = planes[1];
  view.light = planes[2];
  view.expected = planes[3];
  view.mixed = planes[4];
  for (size_t h = 0; h < 2; ++h) {
    view.noisy[h] = noisy[h];
    view.base[h] = base[h];
    view.coverage[h] = coverage[h];
  }
  view.offsets = offsets;
  view.point_weights = point_weights;
  view.point_samples = point_samples;
  return view;
}

bool CanSend(const RefineCall& call) {
  const size_t points = call.filterings.empty() ? 0 : PointsOf(call.filterings);
  return CanSend(call.filterings) && HasHalves(call.filterings) && IsValid(HeaderOf(call)) &&
         !(call.fit.has_value() && call.mixed.IsEmpty()) &&
         ForEachList(call,
                     [&](const auto& list, size_t of_point) { return list.size() == points * of_point; });
}

bool SendRefinement(const RefineCall& call, SentPlanes* kept, SocketStream* to) {
  const auto planes = call.Planes();
  const RefineHeader header = HeaderOf(call);
  return SendOperation(Operation::kRefine, to) &&
         SendCallsAnd({planes.begin(), planes.end()}, call.filterings, kept, to) &&
         to->Write(&header, sizeof(header)) &&
         ForEachList(call, [&](const auto& list, size_t) { return SendList(list, to); });
}

std::optional<ReceivedRefinement> ReceiveRefinement(KeptPlanesOfCaller* kept, SocketStream* from) {
  std::optional<ReceivedCalls> calls = ReceiveCalls(kept, from);
  if (!calls.has_value() || calls->others.size() != RefineCall().Planes().size() ||
      calls->others[0].IsEmpty() || calls->others[1].IsEmpty())
    return std::nullopt;
  ReceivedRefinement refinement;
  refinement.filterings = *std::move(calls);
  const std::vector<ManifoldCall> filterings = refinement.filterings.View();
  RefineHeader header = {};
  if (!HasHalves(filterings) || !from->Read(&header, sizeof(header)) || !IsValid(header)) return std::nullopt;
  refinement.call.choice = {header.widest_radius, header.wide_radius,  header.narrow_radius,
                            header.blend_radius,  header.significance, header.dim};
  refinement.call.level = header.level;
  if (header.fits != 0) {
    if (refinement.filterings.others[4].IsEmpty()) return std::nullopt;
    refinement.call.fit = {{header.sigma_px, header.sigma_light, header.slope}, header.knee};
  }
  const size_t points = PointsOf(filterings);
  if (!ForEachList(refinement,
                   [&](auto& list, size_t of_point) { return ReceiveList(points * of_point, from, &list); }))
    return std::nullopt;
  return refinement;
}

bool SendResult(const filter::RefinedHalves& result, SocketStream* to) {
  return SendPlanes(result[0].filtered, to) && SendPlanes(result[1].filtered, to) &&
         SendList(result[0].points.values, to) && SendList(result[1].points.values, to);
}

std::optional<filter::RefinedHalves> ReceiveResult(const RefineCall& call, SocketStream* from) {
  filter::RefinedHalves result;
  for (filter::ManifoldResult& half : result) {
    half.filtered = MakeUninitializedPlanes(3, call.weight.width(), call.weight.height());
    if (!ReceivePlanes(from, &half.filtered)) return std::nullopt;
  }
  for (filter::ManifoldResult& half : result) {
    if (!ReceiveList(3 * PointsOf(call.filterings), from, &half.points.values)) return std::nullopt;
  }
  return result;
}

}  // namespace lumifold::device
