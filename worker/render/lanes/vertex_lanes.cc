#include "worker/render/lanes/vertex_lanes.h"

#include "filter/image/portable_math.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "worker/render/lanes/vertex_lanes.cc"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"

#include "worker/render/lanes/base_lobes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace lumifold::render {
namespace HWY_NAMESPACE {

/// The paths from number `first` on.
HWY_INLINE Num At(const LaneRow& row, size_t first) { return Load(row.data() + first); }
HWY_INLINE Num3 At(const LaneVec& rows, size_t first) {
  return {At(rows.x, first), At(rows.y, first), At(rows.z, first)};
}
HWY_INLINE void Put(Num a, size_t first, LaneRow* row) { Store(a, row->data() + first); }
HWY_INLINE void Put(Num3 a, size_t first, LaneVec* rows) {
  Put(a.x, first, &rows->x);
  Put(a.y, first, &rows->y);
  Put(a.z, first, &rows->z);
}
HWY_INLINE void Put(Mask m, size_t first, LaneRow* row) { Put(Where(m, Num(1.0f)), first, row); }

HWY_INLINE BaseLobes LobesAt(const VertexLanes& in, size_t first, const float* albedos) {
  BaseLobes lobes;
  lobes.geometric = At(in.surface.geometric, first);
  lobes.f0 = At(in.material.f0, first);
  const Num f90 = At(in.material.f90, first);
  lobes.f90 = {f90, f90, f90};
  lobes.alpha = At(in.material.alpha, first);
  lobes.root_alpha = At(in.material.root_alpha, first);
  lobes.dielectric_f0 = At(in.material.dielectric_f0, first);
  lobes.dielectric_f90 = At(in.material.dielectric_f90, first);
  lobes.mean_albedo = At(in.material.mean_albedo, first);
  lobes.Begin(At(in.surface.normal, first), At(in.surface.to_viewer, first),
              At(in.material.base_color, first), At(in.material.metallic, first),
              At(in.material.base_weight, first), albedos);
  return lobes;
}

/// Direction towards the light, its distance and radiance, and the density of the sample; 0: there is none.
struct PickedLight {
  Num3 direction;
  Num distance;
  Num pdf;
};

/// See LightSet::SampleTriangle.
HWY_INLINE PickedLight SampleTriangles(const VertexLanes& in, size_t first, Num3 position) {
  const Num ux = At(in.random.light_point.x, first);
  const Num uy = At(in.random.light_point.y, first);
  const Num least = Num(0.5f) * Min(ux, uy);
  const Num3 to_light = At(in.triangle.corner, first) + At(in.triangle.edge1, first) * (ux - least) +
                        At(in.triangle.edge2, first) * (uy - least) - position;
  const Num distance2 = Dot(to_light, to_light);
  PickedLight light;
  light.distance = Sqrt(distance2);
  light.direction = to_light * (Num(1.0f) / light.distance);
  const Num cosine = -Dot(light.direction, At(in.triangle.normal, first));
  const Mask faces =
      And(cosine != Num(0.0f), Or(cosine > Num(0.0f), At(in.triangle.both_sides, first) > Num(0.0f)));
  light.pdf = Where(And(distance2 > Num(0.0f), faces), At(in.triangle.inverse_area, first) * distance2 /
                                                           Abs(cosine) * At(in.triangle.probability, first));
  return light;
}

/// See PathTracer::SampleLight.
HWY_INLINE void Connect(const VertexLanes& in, size_t first, const BaseLobes& lobes, const float* albedos,
                        ShadedLanes* out) {
  const Num3 position = At(in.surface.position, first);
  PickedLight light = SampleTriangles(in, first, position);
  const Mask is_sampled = At(in.light.is_sampled, first) > Num(0.0f);
  light.direction = Select(is_sampled, At(in.light.direction, first), light.direction);
  light.distance = Select(is_sampled, At(in.light.distance, first), light.distance);
  light.pdf = Select(is_sampled, At(in.light.pdf, first), light.pdf);
  const LobeValue value = lobes.Evaluate(light.direction, albedos);
  const Mask is_lit =
      And(light.pdf > Num(0.0f), Or(value.diffuse > Num(0.0f), MaxComponent(value.non_diffuse) > Num(0.0f)));
  const Num competing =
      Select(And(is_sampled, At(in.light.is_delta, first) > Num(0.0f)), Num(0.0f), value.pdf);
  Put(Where(is_lit, At(in.light.radiance, first) * (Num(1.0f) / (light.pdf + competing))), first,
      &out->connection.light);
  Put(value.diffuse, first, &out->connection.diffuse);
  Put(value.non_diffuse, first, &out->connection.non_diffuse);
  // The shadow ray ends before the light, at the sampled point itself; see SetShadowRay.
  const Num epsilon = At(in.surface.epsilon, first);
  const Num side = Select(Dot(light.direction, lobes.geometric) < Num(0.0f), -epsilon, epsilon);
  const Num3 origin = position + lobes.geometric * side;
  const Num3 segment = position + light.direction * light.distance - origin;
  const Num length = Length(segment);
  const Mask is_finite = light.distance < Num(hwy::HighestValue<float>());
  Put(origin, first, &out->connection.origin);
  Put(Select(is_finite, segment * (Num(1.0f) / length), light.direction), first, &out->connection.direction);
  Put(Select(is_finite, length * Num(1.0f - 0x1p-12f), light.distance), first, &out->connection.distance);
}

/// See PathTracer::Step.
HWY_INLINE void TakeStep(const VertexLanes& in, size_t first, const BaseLobes& lobes, const float* albedos,
                         ShadedLanes* out) {
  const Num3 throughput = At(in.path.throughput, first);
  const Num estimate = MaxComponent(throughput * (lobes.diffuse_albedo + lobes.facets_albedo));
  const Num scale = At(in.path.scale, first);
  const Num survival =
      Select(scale > Num(0.0f), Min(Num(1.0f), estimate * scale * At(in.path.unit, first)), Num(1.0f));
  const Num u = At(in.random.light_and_lobe.y, first);
  const Mask is_certain = survival >= Num(1.0f);
  const Mask survives = Or(is_certain, u < survival);
  const Num u_lobe = Select(is_certain, u, Min(u / survival, Num(0x1.fffffep-1f)));
  const LobeSample step =
      lobes.Sample(u_lobe, {At(in.random.direction.x, first), At(in.random.direction.y, first)}, albedos);
  Put(estimate, first, &out->estimate);
  Put(Where(survives, survival), first, &out->step.survival);
  Put(step.direction, first, &out->step.direction);
  Put(step.value.diffuse, first, &out->step.diffuse);
  Put(step.value.non_diffuse, first, &out->step.non_diffuse);
  Put(step.value.pdf, first, &out->step.pdf);
}

using BitsTag = hn::RebindToUnsigned<LaneTag>;
using BitsVec = hn::Vec<BitsTag>;

HWY_INLINE BitsVec Constant(uint32_t bits) { return hn::Set(BitsTag(), bits); }

template <int kShift>
HWY_INLINE BitsVec SwapBits(BitsVec x, uint32_t low) {
  return hn::Or(hn::ShiftLeft<kShift>(hn::And(x, Constant(low))),
                hn::And(hn::ShiftRight<kShift>(x), Constant(low)));
}

// The functions of sampler.cc.
HWY_INLINE BitsVec ReverseBits(BitsVec x) {
  x = hn::Or(hn::ShiftLeft<16>(x), hn::ShiftRight<16>(x));
  x = SwapBits<8>(x, 0x00ff00ffu);
  x = SwapBits<4>(x, 0x0f0f0f0fu);
  x = SwapBits<2>(x, 0x33333333u);
  return SwapBits<1>(x, 0x55555555u);
}

HWY_INLINE BitsVec ScrambleReversed(BitsVec x, BitsVec seed) {
  x = hn::Xor(x, hn::Mul(x, Constant(0x3d20adeau)));
  x = hn::Add(x, seed);
  x = hn::Mul(x, hn::Or(hn::ShiftRight<16>(seed), Constant(1)));
  x = hn::Xor(x, hn::Mul(x, Constant(0x05526c56u)));
  return hn::Xor(x, hn::Mul(x, Constant(0x53a22864u)));
}

HWY_INLINE BitsVec SobolSecondReversed(BitsVec i) {
  i = hn::Xor(i, hn::And(hn::ShiftRight<1>(i), Constant(0x55555555u)));
  i = hn::Xor(i, hn::And(hn::ShiftRight<2>(i), Constant(0x33333333u)));
  i = hn::Xor(i, hn::And(hn::ShiftRight<4>(i), Constant(0x0f0f0f0fu)));
  i = hn::Xor(i, hn::And(hn::ShiftRight<8>(i), Constant(0x00ff00ffu)));
  return hn::Xor(i, hn::And(hn::ShiftRight<16>(i), Constant(0x0000ffffu)));
}

HWY_INLINE void PutUnitFloats(BitsVec x, size_t first, LaneRow* row) {
  const auto whole = hn::BitCast(IntLaneTag(), hn::ShiftRight<8>(x));
  Put(Num(hn::ConvertTo(LaneTag(), whole)) * Num(0x1p-24f), first, row);
}

HWY_INLINE void DrawPair(const RandomLanes& in, size_t pair, size_t first, LanePair* out) {
  const BitsTag d;
  const BitsVec shuffle = hn::LoadU(d, in.shuffle[pair].data() + first);
  const BitsVec scramble_x = hn::LoadU(d, in.scramble[pair].data() + first);
  const BitsVec scramble_y = hn::Add(hn::Mul(scramble_x, Constant(0x9e3779b1u)), shuffle);
  const BitsVec index =
      ReverseBits(ScrambleReversed(hn::LoadU(d, in.reversed_index.data() + first), shuffle));
  PutUnitFloats(ReverseBits(ScrambleReversed(index, scramble_x)), first, &out->x);
  PutUnitFloats(ReverseBits(ScrambleReversed(SobolSecondReversed(index), scramble_y)), first, &out->y);
}

void DrawLanes(RandomLanes* random, size_t count) {
  for (size_t first = 0; first < count; first += hn::Lanes(LaneTag())) {
    DrawPair(*random, 0, first, &random->light_and_lobe);
    DrawPair(*random, 1, first, &random->light_point);
    DrawPair(*random, 2, first, &random->direction);
  }
}

void ShadeLanes(const VertexLanes& in, size_t count, const float* albedos, ShadedLanes* out) {
  for (size_t first = 0; first < count; first += hn::Lanes(LaneTag())) {
    const BaseLobes lobes = LobesAt(in, first, albedos);
    Put(lobes.diffuse_albedo, first, &out->diffuse_albedo);
    Put(lobes.facets_albedo, first, &out->glossy_albedo);
    Put(lobes.p_diffuse > Num(0.0f), first, &out->has_diffuse);
    Put(lobes.p_facets > Num(0.0f), first, &out->has_facets);
    Connect(in, first, lobes, albedos, out);
    TakeStep(in, first, lobes, albedos, out);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace lumifold::render
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace lumifold::render {

HWY_EXPORT(DrawLanes);
HWY_EXPORT(ShadeLanes);

void DrawLanes(RandomLanes* random, size_t count) { HWY_DYNAMIC_DISPATCH(DrawLanes)(random, count); }

void ShadeLanes(const VertexLanes& in, size_t count, const float* albedos, ShadedLanes* out) {
  HWY_DYNAMIC_DISPATCH(ShadeLanes)(in, count, albedos, out);
}

}  // namespace lumifold::render
#endif
