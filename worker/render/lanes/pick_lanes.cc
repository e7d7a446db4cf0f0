#include "worker/render/lanes/pick_lanes.h"

#include <limits>

#include "worker/render/lanes/vertex_lanes.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "worker/render/lanes/pick_lanes.cc"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"

#include "worker/render/lanes/numbers-inl.h"

HWY_BEFORE_NAMESPACE();
namespace lumifold::render {
namespace HWY_NAMESPACE {

#include "worker/render/lights/importance-inl.h"

/// The numbers of the emitters that u selects, and their shares of the weight.
struct Picked {
  Num emitter;
  Num probability;
};

/// Where Num is a vector of shading points.
HWY_INLINE Picked PickFrom(const LightLeaf& leaf, Num3 position, Num3 normal, Num u) {
  if (leaf.count == 1) return {0.0f, 1.0f};  // whatever it is worth
  const Num zero = 0.0f;
  std::array<Num, LightLeaf::kSize> weights;
  Num sum = 0.0f;
  for (size_t i = 0; i < leaf.count; ++i) {
    weights[i] = Importance(leaf.At(i), position, normal, 1.0f);
    sum = sum + weights[i];
  }
  Num left = u * sum;
  Num slot = 0.0f;
  Num weight = zero;
  for (size_t i = 0; i < leaf.count; ++i) {
    const Mask is_candidate = And(left >= zero, weights[i] > zero);
    slot = Select(is_candidate, static_cast<float>(i), slot);
    weight = Select(is_candidate, weights[i], weight);
    left = left - weights[i];
  }
  return {slot, Where(sum > zero, weight / sum)};
}

void PickLanes(const LightLeaf& leaf, float share, size_t count, VertexLanes* lanes) {
  for (size_t first = 0; first < count; first += hn::Lanes(LaneTag())) {
    const auto surface = [&](size_t lane) { return &lanes->vertices[first + lane].surface->position.x; };
    const Num4 position = LoadFours(surface);
    const Num4 normal = LoadFours([&](size_t lane) { return surface(lane) + 4; });
    const Num u = Load(lanes->random.light_and_lobe.x.data() + first) / Num(share);
    const Picked picked = PickFrom(leaf, position.xyz(), normal.xyz(), u);
    Store(picked.emitter, lanes->choice.slot.data() + first);
    Store(picked.probability, lanes->choice.probability.data() + first);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace lumifold::render
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace lumifold::render {

HWY_EXPORT(PickLanes);

void PickLanes(const LightLeaf& leaf, float share, size_t count, VertexLanes* lanes) {
  HWY_DYNAMIC_DISPATCH(PickLanes)(leaf, share, count, lanes);
}

}  // namespace lumifold::render
#endif
