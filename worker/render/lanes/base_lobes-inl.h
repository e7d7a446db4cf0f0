// Included once for each instruction set: by files of kernels alone, after hwy/foreach_target.h.
#if defined(LUMIFOLD_RENDER_LANES_BASE_LOBES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef LUMIFOLD_RENDER_LANES_BASE_LOBES_INL_H_
#undef LUMIFOLD_RENDER_LANES_BASE_LOBES_INL_H_
#else
#define LUMIFOLD_RENDER_LANES_BASE_LOBES_INL_H_
#endif

#include "worker/render/lanes/numbers-inl.h"

HWY_BEFORE_NAMESPACE();
namespace lumifold::render {
namespace HWY_NAMESPACE {

/// See DirectionalAlbedo.
struct AlbedoLanes {
  Num scale, bias;
};

/// AlbedoTable::Lookup; `root_alpha` is the root of alpha.
HWY_INLINE AlbedoLanes LookUp(const float* albedos, Num cosine, Num root_alpha) {
  constexpr int kSize = 32;
  const IntLaneTag di;
  const auto place = [](Num x) { return Min(Max(x, Num(0.0f)), Num(1.0f)) * Num(kSize - 1.0f); };
  const Num row = place(root_alpha);
  const Num column = place(cosine);
  const auto last = hn::Set(di, kSize - 2);
  // Lanes without meaning may hold NaN; they too must read from the table.
  const auto whole = [&](Num x) { return hn::Max(hn::Min(hn::ConvertTo(di, x.v), last), hn::Zero(di)); };
  const auto r = whole(row);
  const auto c = whole(column);
  const Num row_part = row - hn::ConvertTo(LaneTag(), r);
  const Num column_part = column - hn::ConvertTo(LaneTag(), c);
  // Scale and bias of two nodes side by side lie in a row.
  alignas(64) std::array<int32_t, kMaxLanes> at;
  hn::Store(hn::ShiftLeft<1>(hn::Add(hn::ShiftLeft<5>(r), c)), di, at.data());
  const Num4 lower = LoadFours([&](size_t lane) { return albedos + at[lane]; });
  const Num4 upper = LoadFours([&](size_t lane) { return albedos + at[lane] + 2 * kSize; });
  const auto mix = [](Num a, Num b, Num t) { return a + (b - a) * t; };
  return {mix(mix(lower.x, lower.z, column_part), mix(upper.x, upper.z, column_part), row_part),
          mix(mix(lower.y, lower.w, column_part), mix(upper.y, upper.w, column_part), row_part)};
}

#include "worker/render/materials/ggx-inl.h"
#include "worker/render/sampling/directions-inl.h"

/// BsdfValue with the density of Sample().
struct LobeValue {
  Num diffuse;
  Num3 non_diffuse;
  Num pdf;
};

/// A sampled direction; `value` is over the density, which is 0 where there is none.
struct LobeSample {
  Num3 direction;
  LobeValue value;
};

/// What Bsdf is for materials that have no lobes but the diffuse one and rough reflection.
struct BaseLobes {
  Frame frame;
  Num3 geometric;
  Num3 wo;  // in the frame
  Num3 diffuse_albedo, facets_albedo;
  Num3 f0, f90;
  Num alpha, root_alpha;
  Num dielectric_f0, dielectric_f90, mean_albedo;
  Num p_diffuse, p_facets;
  Mask is_diffuse;  // it is the only lobe

  /// Computes the albedos and probabilities; what the material alone determines is set.
  HWY_INLINE void Begin(Num3 normal, Num3 to_viewer, Num3 base_color, Num metallic, Num base_weight,
                        const float* albedos) {
    const Num zero = 0.0f;
    const Num one = 1.0f;
    frame = Frame::Of(normal);
    wo = frame.ToLocal(to_viewer);
    wo.z = Max(wo.z, Num(1e-4f));
    AlbedoLanes seen = {zero, zero};
    if (Any(f90.x > zero)) {
      const AlbedoLanes found = LookUp(albedos, wo.z, root_alpha);
      seen = {Where(f90.x > zero, found.scale), Where(f90.x > zero, found.bias)};
    }
    const Num dielectric_albedo =
        Where(dielectric_f90 > zero, Min(dielectric_f0 * seen.scale + dielectric_f90 * seen.bias, one));
    diffuse_albedo = base_color * (base_weight * (one - dielectric_albedo));
    facets_albedo = f0 * seen.scale + f90 * seen.bias;
    const Mask is_metal = metallic > zero;
    if (Any(is_metal)) Compensate(is_metal, base_color, metallic, seen);
    ChooseProbabilities();
  }

  /// Bsdf::CompensateMetal.
  HWY_INLINE void Compensate(Mask is_metal, Num3 b, Num metallic, AlbedoLanes seen) {
    const Num one = 1.0f;
    const Num3 gain =
        Select(is_metal, MetalGain(b, metallic, seen.scale, seen.bias, facets_albedo), Num3{one, one, one});
    f0 = f0 * gain;
    f90 = f90 * gain;
    facets_albedo = facets_albedo * gain;
  }

  HWY_INLINE void ChooseProbabilities() {
    const Num zero = 0.0f;
    const Num facets = Luminance(facets_albedo);
    const Num diffuse = Luminance(diffuse_albedo);
    p_diffuse = Where(diffuse > zero, Max(diffuse / (diffuse + facets), Num(0.05f)));
    p_facets = Where(facets > zero, facets * ((Num(1.0f) - p_diffuse) / facets));
    is_diffuse = And(p_diffuse >= Num(1.0f), dielectric_f90 <= zero);
  }

  /// Bsdf::Evaluate.
  HWY_INLINE LobeValue Evaluate(Num3 wi_world, const float* albedos) const {
    const Num zero = 0.0f;
    const Mask is_above = Dot(wi_world, geometric) > zero;
    if (All(is_diffuse)) {
      const Num cosine = Dot(wi_world, frame.z);
      const Num pdf = Where(And(cosine > zero, is_above), cosine / Num(kPi));
      return {pdf, {zero, zero, zero}, pdf};
    }
    const Num3 wi = frame.ToLocal(wi_world);
    const Mask is_up = And(is_above, wi.z > zero);
    Num coupling = 1.0f;
    if (Any(dielectric_f90 > zero)) {
      const AlbedoLanes seen = LookUp(albedos, wi.z, root_alpha);
      const Num share =
          (Num(1.0f) - Min(dielectric_f0 * seen.scale + dielectric_f90 * seen.bias, Num(1.0f))) /
          (Num(1.0f) - mean_albedo);
      coupling = Select(dielectric_f90 > zero, share, coupling);
    }
    const Mask diffuses = And(is_up, p_diffuse > zero);
    LobeValue value;
    value.diffuse = Where(diffuses, coupling * wi.z / Num(kPi));
    value.pdf = Where(diffuses, p_diffuse * wi.z / Num(kPi));
    const Mask reflects = And(is_up, p_facets > zero);
    const Num3 h = Normalize(wi + wo);
    const Num cos_h = Max(Dot(wo, h), Num(1e-6f));
    const Num lobe = GgxDensity(h, alpha) * GgxVisibility(wi, wo, alpha) * wi.z;
    value.non_diffuse = Where(reflects, SchlickFresnel(f0, f90, cos_h) * lobe);
    const Num visible = GgxVisibleDensity(wo, h, alpha);
    value.pdf = value.pdf + Where(reflects, p_facets * visible / (Num(4.0f) * cos_h));
    return value;
  }

  /// Bsdf::Sample.
  HWY_INLINE LobeSample Sample(Num u_lobe, Num2 u, const float* albedos) const {
    const Num zero = 0.0f;
    const Num2 disk = ConcentricDisk(u);
    const Num3 cosine = CosineDirection(disk);
    LobeSample sample;
    if (All(is_diffuse)) {
      sample.direction = frame.ToWorld(cosine);
      const Mask is_valid = And(cosine.z > zero, Dot(sample.direction, geometric) > zero);
      sample.value = {1.0f, {zero, zero, zero}, Where(is_valid, cosine.z / Num(kPi))};
      return sample;
    }
    const Mask is_cosine = u_lobe < p_diffuse;
    const Num3 h = SampleGgxVisibleNormal(wo, alpha, disk);
    const Num3 mirrored = MirrorDirection(wo, h);
    sample.direction = frame.ToWorld(Select(is_cosine, cosine, mirrored));
    const LobeValue value = Evaluate(sample.direction, albedos);
    const Mask is_valid = Or(is_cosine, And(p_facets > zero, mirrored.z > zero));
    sample.value = {value.diffuse / value.pdf, value.non_diffuse / value.pdf, Where(is_valid, value.pdf)};
    if (Any(is_diffuse)) {
      const Mask is_above = And(cosine.z > zero, Dot(sample.direction, geometric) > zero);
      sample.value.diffuse = Select(is_diffuse, Num(1.0f), sample.value.diffuse);
      sample.value.pdf = Select(is_diffuse, Where(is_above, cosine.z / Num(kPi)), sample.value.pdf);
    }
    return sample;
  }
};

}  // namespace HWY_NAMESPACE
}  // namespace lumifold::render
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
