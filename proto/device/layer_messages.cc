#include "proto/device/layer_messages.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "proto/device/message_parts.h"

namespace lumifold::device {
namespace {

using filter::GuidedHalves;
using filter::LayerCall;

// Far above what our methods ask for; see message_parts.h.
constexpr float kMostSigma = 40;         // of fits, pixels: windows are within kMostRadius
constexpr int32_t kMostPatchRadius = 8;  // products of patches grow with its fourth power
constexpr int32_t kMostDimensions = 16;  // of their coordinates
constexpr uint32_t kMostScales = 8;
constexpr uint32_t kMostGeometry = 16;

// Without padding, as message_parts.h says.
struct GuidedHeader {
  ParamsHeader manifolds;
  int32_t radius, least_dimensions, most_dimensions;  // of patches
  uint32_t scales;
  float sigma_q;
  double explained_variance;
};
struct ChoiceHeader {
  int32_t widest_radius, wide_radius, narrow_radius, blend_radius;
  float significance, dim;
};
struct FitHeader {
  float sigma_px, sigma_light, slope;
};
enum class Removed : uint32_t { kNothing, kIsGone, kReturns };
struct RemovedHeader {
  Removed what;
  float spread_light;
  int32_t spread_height;
};
/// What there may be.
struct HasHeader {
  uint32_t light, expected, mixed;  // planes
  uint32_t points, fit;
};
struct LayerHeader {
  int32_t width, height;
  HasHeader has;
  uint32_t may_stay_noisy, geometry;
  float level, knee, reach;
  GuidedHeader first, further;
  ChoiceHeader choice;
  FitHeader fit;
  RemovedHeader removed;
};
static_assert(sizeof(GuidedHeader) == 56 && sizeof(LayerHeader) == 24 * 4 + 2 * sizeof(GuidedHeader));

GuidedHeader HeaderOf(const GuidedHalves& halves) {
  return {.manifolds = ParamsHeaderOf(halves.manifolds),
          .radius = halves.patches.radius,
          .least_dimensions = halves.patches.least_dimensions,
          .most_dimensions = halves.patches.most_dimensions,
          .scales = static_cast<uint32_t>(halves.scales.size()),
          .sigma_q = halves.sigma_q,
          .explained_variance = halves.patches.explained_variance};
}

GuidedHalves HalvesOf(const GuidedHeader& header) {
  return {ParamsOf(header.manifolds),
          {header.radius, header.least_dimensions, header.most_dimensions, header.explained_variance},
          header.sigma_q,
          {}};
}

uint32_t Word(bool is) { return is ? 1 : 0; }

LayerHeader HeaderOf(const LayerCall& call) {
  const filter::ChoiceParams& choice = call.choice;
  const filter::RegressionParams fit = call.fit.value_or(filter::RegressionParams{});
  const filter::RemovedLight removed = call.removed.value_or(filter::RemovedLight{});
  const filter::HalvesOfLayer& halves = call.halves;
  return {.width = halves.weight.width(),
          .height = halves.weight.height(),
          .has = {.light = Word(!halves.picture_light.IsEmpty()),
                  .expected = Word(!halves.expected_difference.IsEmpty()),
                  .mixed = Word(!halves.is_mixed.IsEmpty()),
                  .points = Word(call.points.of_halves[0] != nullptr),
                  .fit = Word(call.fit.has_value())},
          .may_stay_noisy = Word(call.may_stay_noisy),
          .geometry = static_cast<uint32_t>(call.geometry.size()),
          .level = halves.level,
          .knee = call.knee,
          .reach = call.reach_px,
          .first = HeaderOf(call.first),
          .further = HeaderOf(call.further),
          .choice = {choice.widest_radius, choice.wide_radius, choice.narrow_radius, choice.blend_radius,
                     choice.significance, choice.dim},
          .fit = {fit.sigma_px, fit.sigma_light, fit.slope},
          .removed = {!call.removed.has_value() ? Removed::kNothing
                      : removed.returns         ? Removed::kReturns
                                                : Removed::kIsGone,
                      removed.spread_light, removed.spread_height}};
}

bool IsValid(const GuidedHeader& header, uint32_t most_scales) {
  const auto is_dimension = [](int32_t count) { return count >= 0 && count <= kMostDimensions; };
  return IsValid(header.manifolds) && header.radius >= 0 && header.radius <= kMostPatchRadius &&
         is_dimension(header.least_dimensions) && is_dimension(header.most_dimensions) &&
         std::isfinite(header.explained_variance) && std::isfinite(header.sigma_q) &&
         header.scales <= most_scales;
}

bool IsValid(const ChoiceHeader& header) {
  // Wide windows are cut at the picture, narrow ones are summed pixel by pixel.
  const auto is_radius = [](int32_t radius, int32_t most) { return radius >= 0 && radius <= most; };
  return is_radius(header.widest_radius, kMostSide) && is_radius(header.wide_radius, kMostSide) &&
         is_radius(header.narrow_radius, kMostRadius) && is_radius(header.blend_radius, kMostRadius) &&
         std::isfinite(header.significance) && std::isfinite(header.dim);
}

bool IsValid(const FitHeader& header) {
  return IsPositive(header.sigma_px, kMostSigma) && std::isfinite(header.sigma_light) &&
         std::isfinite(header.slope);
}

bool IsValid(const LayerHeader& header) {
  if (!IsSize(header.width, header.height)) return false;
  if (header.geometry < 1 || header.geometry > kMostGeometry) return false;
  if (!std::isfinite(header.level) || !std::isfinite(header.knee) || !IsReach(header.reach)) return false;
  if (!IsValid(header.first, 1) || header.first.scales != 1) return false;
  if (!IsValid(header.further, kMostScales) || !IsValid(header.choice) || !IsValid(header.fit)) return false;
  if (header.has.fit != 0 && header.has.mixed == 0) return false;
  return header.removed.what <= Removed::kReturns && std::isfinite(header.removed.spread_light) &&
         IsTree(header.removed.spread_height);
}

PointLimits LimitsOf(const LayerHeader& header) { return {header.width, header.height, header.geometry, 3}; }

/// Whether both halves have the same number of points, with light and shares.
bool AreOfHalves(const filter::SlicePoints& a, const filter::SlicePoints& b) {
  const size_t count = a.pixels.size();
  const auto has_all = [&](const filter::SlicePoints& half) {
    return half.pixels.size() == count && half.own_features == a.own_features &&
           half.features.size() == count * half.own_features && half.signals.size() == 3 * count &&
           half.weights.size() == count;
  };
  return has_all(a) && has_all(b);
}

/// The planes that are there, in their order.
filter::PlaneViews PlanesOf(const LayerCall& call) {
  const filter::HalvesOfLayer& halves = call.halves;
  filter::PlaneViews planes = {halves.masks[0], halves.masks[1], halves.weight, halves.share_a,
                               halves.samples};
  for (const ConstFloatView& plane : {halves.picture_light, halves.expected_difference, halves.is_mixed}) {
    if (!plane.IsEmpty()) planes.push_back(plane);
  }
  const auto add = [&](const filter::PlaneViews& more) {
    planes.insert(planes.end(), more.begin(), more.end());
  };
  add(call.geometry);
  for (const filter::PlaneViews& half : halves.light) add(half);
  if (!call.removed.has_value()) return planes;
  for (const filter::PlaneViews& half : call.removed->planes) add(half);
  return planes;
}

size_t PlaneCountOf(const LayerHeader& header) {
  const auto count_if = [](bool has, size_t count) { return has ? count : 0; };
  return 5 + count_if(header.has.light != 0, 1) + count_if(header.has.expected != 0, 1) +
         count_if(header.has.mixed != 0, 1) + header.geometry + 6 +
         count_if(header.removed.what != Removed::kNothing, 6);
}

/// All lists of points, with the numbers of floats that a point has.
template <typename Points, typename Use>
bool ForEachList(Points& points, const Use& use) {
  bool works = true;
  for (size_t h = 0; h < 2; ++h) works = works && use(points.uncut[h], 3) && use(points.coverage[h], 1);
  return works && use(points.offsets, 2) && use(points.weights, 1) && use(points.samples, 1);
}

LayerCall CallOf(const LayerHeader& header) {
  LayerCall call;
  call.halves.level = header.level;
  call.knee = header.knee;
  call.reach_px = header.reach;
  call.first = HalvesOf(header.first);
  call.further = HalvesOf(header.further);
  const ChoiceHeader& choice = header.choice;
  call.choice = {choice.widest_radius, choice.wide_radius,  choice.narrow_radius,
                 choice.blend_radius,  choice.significance, choice.dim};
  if (header.has.fit != 0) call.fit = {header.fit.sigma_px, header.fit.sigma_light, header.fit.slope};
  if (header.removed.what != Removed::kNothing)
    call.removed = {.planes = {},
                    .returns = header.removed.what == Removed::kReturns,
                    .spread_light = header.removed.spread_light,
                    .spread_height = header.removed.spread_height};
  call.may_stay_noisy = header.may_stay_noisy != 0;
  return call;
}

bool AreFinite(const std::vector<float>& values) {
  return std::all_of(values.begin(), values.end(), [](float value) { return std::isfinite(value); });
}

bool ReceiveScales(const GuidedHeader& header, SocketStream* from, GuidedHalves* halves) {
  return ReceiveList(header.scales, from, &halves->scales) && AreFinite(halves->scales);
}

bool ReceivePointsOfHalves(const LayerHeader& header, SocketStream* from, ReceivedLayer* layer) {
  if (header.has.points == 0) return true;
  for (size_t h = 0; h < 2; ++h) {
    if (!ReceivePoints(LimitsOf(header), from, &layer->points)) return false;
  }
  return AreOfHalves(layer->points[0], layer->points[1]);
}

}  // namespace

LayerCall ReceivedLayer::View() const {
  LayerCall view = call;
  filter::HalvesOfLayer& halves = view.halves;
  size_t next = 0;
  const auto take = [&] { return planes[next++].view(); };
  const auto take_all = [&](size_t count) {
    filter::PlaneViews views;
    for (size_t i = 0; i < count; ++i) views.push_back(take());
    return views;
  };
  for (ConstFloatView* plane :
       {halves.masks.data(), &halves.masks[1], &halves.weight, &halves.share_a, &halves.samples})
    *plane = take();
  ConstFloatView* const others[] = {&halves.picture_light, &halves.expected_difference, &halves.is_mixed};
  for (size_t i = 0; i < has.size(); ++i) {
    if (has[i]) *others[i] = take();
  }
  view.geometry = take_all(geometry);
  for (filter::PlaneViews& half : halves.light) half = take_all(3);
  if (view.removed.has_value()) {
    for (filter::PlaneViews& half : view.removed->planes) half = take_all(3);
  }
  for (size_t h = 0; h < 2; ++h) {
    if (!points.empty()) view.points.of_halves[h] = &points[h];
    view.points.uncut[h] = lists.uncut[h];
    view.points.coverage[h] = lists.coverage[h];
  }
  view.points.offsets = lists.offsets;
  view.points.weights = lists.weights;
  view.points.samples = lists.samples;
  return view;
}

bool CanSend(const LayerCall& call) {
  const LayerHeader header = HeaderOf(call);
  const bool has_points = call.points.of_halves[0] != nullptr;
  if (!IsValid(header) || !AreFinite(call.first.scales) || !AreFinite(call.further.scales)) return false;
  if (has_points && !(call.points.of_halves[1] != nullptr &&
                      AreOfHalves(*call.points.of_halves[0], *call.points.of_halves[1]) &&
                      CanSend(*call.points.of_halves[0], LimitsOf(header))))
    return false;
  return ForEachList(call.points, [&](const auto& list, size_t of_point) {
    return list.size() == call.points.Count() * of_point;
  });
}

bool SendLayer(const LayerCall& call, SocketStream* to) {
  const LayerHeader header = HeaderOf(call);
  bool works = SendOperation(Operation::kLayer, to) && to->Write(&header, sizeof(header)) &&
               SendList(call.first.scales, to) && SendList(call.further.scales, to) &&
               SendPlanes(PlanesOf(call), to);
  for (size_t h = 0; h < 2 && header.has.points != 0; ++h)
    works = works && SendPoints(*call.points.of_halves[h], *call.points.of_halves[0], to);
  return works && ForEachList(call.points, [&](const auto& list, size_t) { return SendList(list, to); });
}

std::optional<ReceivedLayer> ReceiveLayer(SocketStream* from) {
  LayerHeader header = {};
  if (!from->Read(&header, sizeof(header)) || !IsValid(header)) return std::nullopt;
  ReceivedLayer layer;
  layer.call = CallOf(header);
  layer.has = {header.has.light != 0, header.has.expected != 0, header.has.mixed != 0};
  layer.geometry = header.geometry;
  if (!ReceiveScales(header.first, from, &layer.call.first) ||
      !ReceiveScales(header.further, from, &layer.call.further) ||
      !ReceivePlanes({PlaneCountOf(header), header.width, header.height}, from, &layer.planes) ||
      !ReceivePointsOfHalves(header, from, &layer))
    return std::nullopt;
  const size_t points = layer.points.empty() ? 0 : layer.points[0].pixels.size();
  if (!ForEachList(layer.lists,
                   [&](auto& list, size_t of_point) { return ReceiveList(points * of_point, from, &list); }))
    return std::nullopt;
  return layer;
}

bool SendResult(const filter::LayerResult& result, SocketStream* to) {
  bool works = true;
  for (const filter::ManifoldResult& half : result.halves)
    works = works && SendPlanes(filter::ViewsOf(half.filtered), to) && SendList(half.points.values, to);
  return works && SendPlanes(filter::ViewsOf(result.returned), to);
}

std::optional<filter::LayerResult> ReceiveResult(const LayerCall& call, SocketStream* from) {
  const PlaneCount planes = {3, call.halves.weight.width(), call.halves.weight.height()};
  filter::LayerResult result;
  for (filter::ManifoldResult& half : result.halves) {
    if (!ReceivePlanes(planes, from, &half.filtered) ||
        !ReceiveList(3 * call.points.Count(), from, &half.points.values))
      return std::nullopt;
  }
  const bool returns = call.removed.has_value() && call.removed->returns;
  if (returns && !ReceivePlanes(planes, from, &result.returned)) return std::nullopt;
  return result;
}

}  // namespace lumifold::device
