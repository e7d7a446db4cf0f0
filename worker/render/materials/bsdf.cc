#include "worker/render/materials/bsdf.h"

#include <algorithm>
#include <cmath>

#include "filter/image/color.h"
#include "filter/image/portable_math.h"
#include "worker/render/materials/microfacet.h"
#include "worker/render/materials/sheen.h"

namespace lumifold::render {
namespace {

/// A diffuse lobe is sampled with at least this probability, so that D and I never depend on a few samples of
/// large weight.
constexpr float kMinDiffuseProbability = 0.05f;

constexpr float kMinCosine = 1e-4f;

/// The coat of KHR_materials_clearcoat, and its reflectance at normal incidence.
constexpr float kCoatIor = 1.5f;
constexpr float kCoatF0 = 0.04f;

float LuminanceOf(Vec3 c) { return Luminance(c.x, c.y, c.z); }

/// Uniform over the hemisphere: the squared radius of a uniform disk point is uniform in [0, 1], and so is
/// the cosine derived from it.
Vec3 UniformDirection(Vec2 u) {
  const Vec2 disk = ConcentricDisk(u);
  const float r2 = std::min(disk.x * disk.x + disk.y * disk.y, 1.0f);
  const float stretch = std::sqrt(2.0f - r2);
  return {disk.x * stretch, disk.y * stretch, 1.0f - r2};
}

/// A delta event that was sampled with this probability.
BsdfSample WithProbability(BsdfSample event, float probability) {
  event.weight.non_diffuse = event.weight.non_diffuse / probability;
  return event;
}

float NormalReflectance(float ior) {
  const float r = (ior - 1.0f) / (ior + 1.0f);
  return r * r;
}

/// Reflectance at normal incidence of the dielectric layer; the specular factor not included.
Vec3 DielectricF0(const SurfaceMaterial& material) {
  const Vec3 f0 = material.specular_color * NormalReflectance(material.ior);
  return {std::min(f0.x, 1.0f), std::min(f0.y, 1.0f), std::min(f0.z, 1.0f)};
}

Vec3 LocalOnUpperSide(const Frame& frame, Vec3 wo) {
  Vec3 local = frame.ToLocal(wo);
  local.z = std::max(local.z, kMinCosine);
  return local;
}

float CoatFresnel(float coat, float cos_h) {
  return coat * SchlickFresnel({kCoatF0, 0, 0}, {1, 0, 0}, cos_h).x;
}

}  // namespace

bool SurfaceMaterial::IsBaseOnly() const {
  if (transmission > 0 || rare.diffuse_transmission > 0 || clearcoat > 0 || MaxComponent(sheen_color) > 0 ||
      LengthSquared(rare.anisotropy) > 0 || rare.iridescence > 0)
    return false;
  return roughness * roughness >= kDeltaAlpha || IsDiffuseOnly();
}

GgxAlpha SurfaceMaterial::Alpha() const {
  const float least = roughness * roughness;
  const float strength2 = std::min(LengthSquared(rare.anisotropy), 1.0f);
  if (strength2 <= 0) return GgxAlpha(least);
  const float across = std::max(least, kDeltaAlpha);
  return {across + (1.0f - across) * strength2, across};
}

BaseMaterial::BaseMaterial(const SurfaceMaterial& material, const AlbedoTable& table)
    : base_color(material.base_color),
      metallic(material.metallic),
      alpha(material.Alpha().Mean()),
      root_alpha(std::sqrt(alpha)),
      dielectric_f90(material.specular),
      base_weight((1.0f - material.metallic) * (1.0f - material.transmission)) {
  const Vec3 dielectric = DielectricF0(material) * material.specular;
  dielectric_f0 = MaxComponent(dielectric);
  f0 = dielectric * base_weight + base_color * metallic;
  f90 = dielectric_f90 * base_weight + metallic;
  if (dielectric_f90 <= 0) return;
  const DirectionalAlbedo mean = table.Average(alpha);
  mean_albedo = dielectric_f0 * mean.scale + dielectric_f90 * mean.bias;
}

Bsdf::Bsdf(const SurfaceMaterial& material, const AlbedoTable& table, Vec3 normal, Vec3 geometric, Vec3 wo)
    : table_(&table), frame_(FrameAlong(normal, material.rare.anisotropy)), geometric_(geometric) {
  if (material.IsDiffuseOnly()) {
    diffuse_albedo_ = material.base_color;
    p_.diffuse = MaxComponent(diffuse_albedo_) > 0 ? 1.0f : 0.0f;
    return;
  }
  wo_ = LocalOnUpperSide(frame_, wo);
  float share = 1;  // fraction of the light that the layers so far pass to those below
  if (material.clearcoat > 0) share = AddCoat(material, wo);
  if (MaxComponent(material.sheen_color) > 0) share = AddSheen(material, share);
  AddBase(material);
  if (share < 1) ScaleMetalAndBase(share);
  if (material.transmission > 0 && material.metallic < 1) AddGlass(material, share);
  ChooseProbabilities();
}

/// Returns the fraction of the light that the coat passes to the layers below.
float Bsdf::AddCoat(const SurfaceMaterial& material, Vec3 wo) {
  coat_.weight = material.clearcoat;
  coat_.alpha = GgxAlpha(material.clearcoat_roughness * material.clearcoat_roughness);
  coat_.mirror = coat_.alpha.x < kDeltaAlpha;
  coat_.normal = material.coat_normal;
  coat_.wo = LocalOnUpperSide(Frame::Of(coat_.normal), wo);
  if (coat_.mirror) {
    coat_.albedo = CoatFresnel(coat_.weight, coat_.wo.z);
  } else {
    const DirectionalAlbedo seen = table_->Lookup(coat_.wo, coat_.alpha);
    coat_.albedo = coat_.weight * (kCoatF0 * seen.scale + seen.bias);
  }
  return 1.0f - coat_.albedo;
}

/// Adds the sheen, which receives the fraction `share` of the light. Returns the fraction that it passes on.
float Bsdf::AddSheen(const SurfaceMaterial& material, float share) {
  sheen_.alpha = std::max(material.sheen_roughness * material.sheen_roughness, kMinSheenAlpha);
  sheen_.color = material.sheen_color * share;
  sheen_.albedo = table_->Sheen(wo_.z, sheen_.alpha);
  return share * (1.0f - std::min(MaxComponent(material.sheen_color) * sheen_.albedo, 1.0f));
}

/// Adds metal and the diffuse base under its dielectric layer.
void Bsdf::AddBase(const SurfaceMaterial& material) {
  const BaseMaterial base(material, *table_);
  facets_.alpha = material.Alpha();
  facets_.mirror = facets_.alpha.x < kDeltaAlpha;
  facets_.f0 = base.f0;
  facets_.f90 = {base.f90, base.f90, base.f90};
  dielectric_ = {base.dielectric_f0, base.dielectric_f90, base.mean_albedo};

  const DirectionalAlbedo seen = base.f90 > 0 ? table_->Lookup(wo_, facets_.alpha) : DirectionalAlbedo{};
  float dielectric_albedo = 0;
  if (dielectric_.f90 > 0) {
    dielectric_albedo = std::min(dielectric_.f0 * seen.scale + dielectric_.f90 * seen.bias, 1.0f);
  }
  facets_.albedo = facets_.mirror ? SchlickFresnel(facets_.f0, facets_.f90, wo_.z)
                                  : facets_.f0 * seen.scale + facets_.f90 * seen.bias;
  if (material.rare.iridescence > 0) dielectric_albedo = AddFilm(material, base, seen, dielectric_albedo);
  const float passed = base.base_weight * (1.0f - dielectric_albedo);
  diffuse_albedo_ = material.base_color * (passed * (1.0f - material.rare.diffuse_transmission));
  transmitted_albedo_ =
      material.rare.diffuse_transmission_color * (passed * material.rare.diffuse_transmission);
  if (base.metallic > 0 && !facets_.mirror) CompensateMetal(material, seen);
}

/// Adds the film to metal and dielectric layer, whose albedo without it is known. Returns the dielectric
/// layer's albedo in the channel that it reflects most of. A film is seen at many angles at once; its albedo
/// is taken as that at the angle for which Schlick's Fresnel would have its own albedo exactly.
float Bsdf::AddFilm(const SurfaceMaterial& material, const BaseMaterial& base, DirectionalAlbedo seen,
                    float dielectric_albedo) {
  const float outside_ior = 1.0f + (kCoatIor - 1.0f) * material.clearcoat;
  const auto film_on = [&](Vec3 f0) {
    return ThinFilm(material.rare.film_thickness_nm, material.rare.film_ior, outside_ior, f0);
  };
  film_.weight = material.rare.iridescence;
  film_.on_dielectric = film_on(DielectricF0(material));
  film_.on_metal = film_on(material.base_color);
  film_.dielectric = base.dielectric_f90 * base.base_weight;
  film_.metallic = base.metallic;
  const float whole = facets_.mirror ? 1.0f : seen.scale + seen.bias;
  film_.mean_cosine = facets_.mirror || whole <= 0 ? wo_.z : 1.0f - Pow(seen.bias / whole, 0.2f);
  facets_.albedo = Lerp(facets_.albedo, film_.Reflectance(film_.mean_cosine) * whole, film_.weight);
  if (dielectric_.f90 <= 0) return dielectric_albedo;
  const float filmed =
      MaxComponent(film_.on_dielectric.Reflectance(film_.mean_cosine)) * dielectric_.f90 * whole;
  return dielectric_albedo + (filmed - dielectric_albedo) * film_.weight;
}

/// Scales metal's part; see MetalGain.
void Bsdf::CompensateMetal(const SurfaceMaterial& material, DirectionalAlbedo seen) {
  Vec3 b = material.base_color;
  if (film_.weight > 0) b = Lerp(b, film_.on_metal.Reflectance(film_.mean_cosine), film_.weight);
  const Vec3 gain = MetalGain(b, material.metallic, seen.scale, seen.bias, facets_.albedo);
  film_.scale *= gain;
  facets_.f0 *= gain;
  facets_.f90 *= gain;
  facets_.albedo *= gain;
}

/// Reduces the light that metal and base receive to the fraction `share`.
void Bsdf::ScaleMetalAndBase(float share) {
  diffuse_albedo_ *= share;
  transmitted_albedo_ *= share;
  film_.scale *= share;
  facets_.f0 *= share;
  facets_.f90 *= share;
  facets_.albedo *= share;
}

/// Adds glass, which has the base's microfacets and receives the fraction `share` of the light.
void Bsdf::AddGlass(const SurfaceMaterial& material, float share) {
  glass_.thin = material.thin;
  glass_.eta = !glass_.thin && material.inside ? 1.0f / material.ior : material.ior;
  if (!glass_.thin && std::abs(material.ior - 1.0f) < kMinIorDifference) facets_.mirror = true;
  const float whole = (1.0f - material.metallic) * material.transmission * share;
  glass_.weight = whole;
  glass_.tint = material.base_color;
  if (!facets_.mirror) {
    const DirectionalAlbedo seen = table_->Lookup(wo_, facets_.alpha);
    glass_.weight /= glass_.thin ? seen.scale + seen.bias
                                 : table_->Glass(material.ior, material.inside, wo_.z, facets_.alpha.Mean());
  }
  float cos_t = 0;
  const float reflected = DielectricFresnel(wo_.z, glass_.eta, &cos_t);
  facets_.albedo += (Vec3{reflected, reflected, reflected} + glass_.tint * (1.0f - reflected)) * whole;
  glass_.tint *= material.rare.refraction_weight;
}

void Bsdf::ChooseProbabilities() {
  const float facets = LuminanceOf(facets_.albedo);
  const float diffuse = LuminanceOf(diffuse_albedo_);
  const float sheen = sheen_.albedo > 0 ? LuminanceOf(sheen_.color) * sheen_.albedo : 0.0f;
  const float transmitted = LuminanceOf(transmitted_albedo_);
  const float rest = facets + coat_.albedo + sheen + transmitted;
  if (diffuse + rest <= 0) return;
  p_.diffuse = diffuse > 0 ? std::max(diffuse / (diffuse + rest), kMinDiffuseProbability) : 0.0f;
  if (rest <= 0) return;
  const float share = (1.0f - p_.diffuse) / rest;
  p_.facets = facets * share;
  p_.coat = coat_.albedo * share;
  p_.sheen = sheen * share;
  p_.transmitted = transmitted * share;
}

Vec3 Bsdf::GlossyAlbedo() const {
  Vec3 albedo = transmitted_albedo_;
  if (!facets_.mirror) albedo += facets_.albedo;
  if (p_.coat > 0 && !coat_.mirror) albedo += Vec3{coat_.albedo, coat_.albedo, coat_.albedo};
  if (p_.sheen > 0) albedo += sheen_.color * sheen_.albedo;
  return albedo;
}

Vec3 Bsdf::Albedo() const {
  Vec3 albedo = diffuse_albedo_ + facets_.albedo + transmitted_albedo_;
  if (p_.coat > 0) albedo += Vec3{coat_.albedo, coat_.albedo, coat_.albedo};
  if (p_.sheen > 0) albedo += sheen_.color * sheen_.albedo;
  return albedo;
}

float Bsdf::ReflectionAlpha() const {
  if (p_.coat > p_.facets) return coat_.alpha.Mean();
  return p_.facets > 0 ? facets_.alpha.Mean() : 1.0f;
}

Vec3 Bsdf::StraightTransmittance() const {
  if (glass_.weight <= 0 || !glass_.thin || !facets_.mirror) return {0, 0, 0};
  return FresnelAt(wo_.z).transmitted;
}

/// Of both faces together if the glass is thin, with all reflections between them.
Vec3 Bsdf::GlassReflectance(float cos_h, float* cos_t) const {
  const float bare = DielectricFresnel(cos_h, glass_.eta, cos_t);
  if (film_.weight <= 0) {
    const float all = glass_.thin ? 2.0f * bare / (1.0f + bare) : bare;
    return {all, all, all};
  }
  if (bare >= 1) return {1, 1, 1};
  // The film is on the outside. By reciprocity it reflects light from within like the light that this becomes
  // outside.
  const float outside = glass_.eta < 1 ? *cos_t : cos_h;
  const Vec3 front = Lerp({bare, bare, bare}, film_.on_dielectric.Reflectance(outside), film_.weight);
  if (!glass_.thin) return front;
  const auto both = [bare](float f) { return f + (1.0f - f) * (1.0f - f) * bare / (1.0f - f * bare); };
  return {both(front.x), both(front.y), both(front.z)};
}

Bsdf::Fresnel Bsdf::FresnelAt(float cos_h) const {
  Fresnel fresnel;
  fresnel.reflected = SchlickFresnel(facets_.f0, facets_.f90, cos_h);
  if (film_.weight > 0) fresnel.reflected = Lerp(fresnel.reflected, film_.Reflectance(cos_h), film_.weight);
  if (glass_.weight <= 0) return fresnel;
  const Vec3 reflectance = GlassReflectance(cos_h, &fresnel.cos_t);
  fresnel.reflected += glass_.weight * reflectance;
  fresnel.transmitted = glass_.tint * (glass_.weight * (Vec3{1, 1, 1} - reflectance));
  const float r = LuminanceOf(fresnel.reflected);
  const float t = LuminanceOf(fresnel.transmitted);
  if (t > 0) fresnel.p_reflect = r / (r + t);
  return fresnel;
}

float Bsdf::DiffuseLobe(float cos_i) const {
  float coupling = 1;
  if (dielectric_.f90 > 0) {
    const DirectionalAlbedo albedo = table_->Lookup(cos_i, facets_.alpha.Mean());
    coupling = (1.0f - std::min(dielectric_.f0 * albedo.scale + dielectric_.f90 * albedo.bias, 1.0f)) /
               (1.0f - dielectric_.mean_albedo);
  }
  return coupling * cos_i / kPi;
}

void Bsdf::EvaluateFacets(Vec3 wi, BsdfValue* value, float* pdf) const {
  const Vec3 h = Normalize(wi + wo_);
  const float cos_h = std::max(Dot(wo_, h), 1e-6f);
  const float lobe = GgxDensity(h, facets_.alpha) * GgxVisibility(wi, wo_, facets_.alpha) * wi.z;
  const Fresnel fresnel = FresnelAt(cos_h);
  value->non_diffuse += fresnel.reflected * lobe;
  *pdf += p_.facets * fresnel.p_reflect * GgxVisibleDensity(wo_, h, facets_.alpha) / (4.0f * cos_h);
}

/// `wi` lies below the surface.
void Bsdf::EvaluateTransmission(Vec3 wi, BsdfValue* value, float* pdf) const {
  // A thin pane's second face undoes the refraction, so the transmitted lobe is the mirror image of the
  // reflected one.
  const Vec3 h =
      glass_.thin ? Normalize(wo_ + Vec3{wi.x, wi.y, -wi.z}) : RefractionNormal(wo_, wi, glass_.eta);
  const float cos_h = Dot(wo_, h);
  if (cos_h <= 0 || (!glass_.thin && Dot(wi, h) >= 0)) return;
  const Fresnel fresnel = FresnelAt(cos_h);
  const float jacobian = glass_.thin ? 1.0f / (4.0f * cos_h) : RefractionJacobian(wo_, wi, h, glass_.eta);
  const float density = GgxVisibleDensity(wo_, h, facets_.alpha) * jacobian;
  value->non_diffuse += fresnel.transmitted * (density * GgxShadowing(wi, wo_, facets_.alpha));
  *pdf += p_.facets * (1.0f - fresnel.p_reflect) * density;
}

void Bsdf::EvaluateCoat(Vec3 wi_world, BsdfValue* value, float* pdf) const {
  const Vec3 wi = Frame::Of(coat_.normal).ToLocal(wi_world);
  if (wi.z <= 0) return;
  const Vec3 h = Normalize(wi + coat_.wo);
  const float cos_h = std::max(Dot(coat_.wo, h), 1e-6f);
  const float lobe = CoatFresnel(coat_.weight, cos_h) * GgxDensity(h, coat_.alpha) *
                     GgxVisibility(wi, coat_.wo, coat_.alpha) * wi.z;
  value->non_diffuse += {lobe, lobe, lobe};
  *pdf += p_.coat * GgxVisibleDensity(coat_.wo, h, coat_.alpha) / (4.0f * cos_h);
}

void Bsdf::EvaluateSheen(Vec3 wi, BsdfValue* value, float* pdf) const {
  value->non_diffuse += sheen_.color * SheenLobe(wi, wo_, sheen_.alpha);
  *pdf += p_.sheen / (2.0f * kPi);
}

BsdfValue Bsdf::Evaluate(Vec3 wi_world, float* pdf) const {
  BsdfValue value;
  *pdf = 0;
  const Vec3 wi = frame_.ToLocal(wi_world);
  if (Dot(wi_world, geometric_) <= 0) {
    if (wi.z >= 0) return value;
    if (glass_.weight > 0 && !facets_.mirror) EvaluateTransmission(wi, &value, pdf);
    if (p_.transmitted > 0) {
      value.non_diffuse += transmitted_albedo_ * DiffuseLobe(-wi.z);
      *pdf += p_.transmitted * -wi.z / kPi;
    }
    return value;
  }
  if (p_.coat > 0 && !coat_.mirror) EvaluateCoat(wi_world, &value, pdf);
  if (wi.z <= 0) return value;
  if (p_.diffuse > 0) {
    value.diffuse = DiffuseLobe(wi.z);
    *pdf += p_.diffuse * wi.z / kPi;
  }
  if (p_.facets > 0 && !facets_.mirror) EvaluateFacets(wi, &value, pdf);
  if (p_.sheen > 0) EvaluateSheen(wi, &value, pdf);
  return value;
}

BsdfSample Bsdf::Reflection(const Fresnel& fresnel) const {
  BsdfSample sample;
  sample.wi = frame_.ToWorld({-wo_.x, -wo_.y, wo_.z});
  sample.weight.non_diffuse = fresnel.reflected;
  sample.is_delta = true;
  sample.valid = Dot(sample.wi, geometric_) > 0;
  return sample;
}

BsdfSample Bsdf::Transmission(const Fresnel& fresnel) const {
  BsdfSample sample;
  sample.wi =
      Normalize(frame_.ToWorld(glass_.thin ? -wo_ : Refract(wo_, {0, 0, 1}, glass_.eta, fresnel.cos_t)));
  sample.weight.non_diffuse = fresnel.transmitted;
  sample.is_delta = true;
  sample.transmitted = true;
  sample.straight = glass_.thin;
  sample.valid = Dot(sample.wi, geometric_) < 0;
  return sample;
}

BsdfSample Bsdf::DeltaReflection() const {
  return facets_.mirror && p_.facets > 0 ? Reflection(FresnelAt(wo_.z)) : BsdfSample{};
}

BsdfSample Bsdf::DeltaTransmission() const {
  if (!facets_.mirror || p_.facets <= 0 || glass_.weight <= 0) return {};
  return Transmission(FresnelAt(wo_.z));
}

BsdfSample Bsdf::SampleDelta(float u_lobe) const {
  const Fresnel fresnel = FresnelAt(wo_.z);
  if (u_lobe < fresnel.p_reflect) return WithProbability(Reflection(fresnel), p_.facets * fresnel.p_reflect);
  return WithProbability(Transmission(fresnel), p_.facets * (1.0f - fresnel.p_reflect));
}

BsdfSample Bsdf::SampleFacets(float u_lobe, Vec2 u) const {
  if (facets_.mirror) return SampleDelta(u_lobe);
  const Vec3 h = SampleGgxVisibleNormal(wo_, facets_.alpha, ConcentricDisk(u));
  const Vec3 mirrored = MirrorDirection(wo_, h);
  const Fresnel fresnel = glass_.weight > 0 ? FresnelAt(std::max(Dot(wo_, h), 1e-6f)) : Fresnel{};
  if (u_lobe < fresnel.p_reflect)
    return mirrored.z > 0 ? SampleTowards(frame_.ToWorld(mirrored)) : BsdfSample{};
  const Vec3 wi =
      glass_.thin ? Vec3{mirrored.x, mirrored.y, -mirrored.z} : Refract(wo_, h, glass_.eta, fresnel.cos_t);
  return SampleBelow(wi);
}

/// `wi` is in the shading frame, of about unit length.
BsdfSample Bsdf::SampleBelow(Vec3 wi) const {
  if (wi.z >= 0) return {};
  const Vec3 wi_world = Normalize(frame_.ToWorld(wi));
  if (Dot(wi_world, geometric_) >= 0) return {};
  BsdfSample sample = SampleTowards(wi_world);
  sample.transmitted = true;
  return sample;
}

BsdfSample Bsdf::SampleCoat(Vec2 u) const {
  const Frame frame = Frame::Of(coat_.normal);
  if (!coat_.mirror) {
    const Vec3 wi =
        MirrorDirection(coat_.wo, SampleGgxVisibleNormal(coat_.wo, coat_.alpha, ConcentricDisk(u)));
    return wi.z > 0 ? SampleTowards(frame.ToWorld(wi)) : BsdfSample{};
  }
  BsdfSample sample;
  sample.wi = frame.ToWorld({-coat_.wo.x, -coat_.wo.y, coat_.wo.z});
  const float weight = coat_.albedo / p_.coat;
  sample.weight.non_diffuse = {weight, weight, weight};
  sample.is_delta = true;
  sample.valid = Dot(sample.wi, geometric_) > 0;
  return sample;
}

BsdfSample Bsdf::SampleSheen(Vec2 u) const { return SampleTowards(frame_.ToWorld(UniformDirection(u))); }

BsdfSample Bsdf::SampleTowards(Vec3 wi_world) const {
  BsdfSample sample;
  sample.wi = wi_world;
  const BsdfValue value = Evaluate(wi_world, &sample.pdf);
  if (sample.pdf <= 0) return sample;
  sample.weight.diffuse = value.diffuse / sample.pdf;
  sample.weight.non_diffuse = value.non_diffuse / sample.pdf;
  sample.valid = true;
  return sample;
}

BsdfSample Bsdf::Sample(float u_lobe, Vec2 u) const {
  if (u_lobe < p_.diffuse) {
    const Vec3 wi = CosineDirection(ConcentricDisk(u));
    const Vec3 wi_world = frame_.ToWorld(wi);
    if (!IsDiffuseOnly()) return SampleTowards(wi_world);
    BsdfSample sample;  // in proportion to the lobe
    sample.wi = wi_world;
    sample.weight.diffuse = 1;
    sample.pdf = wi.z / kPi;
    sample.valid = wi.z > 0 && Dot(wi_world, geometric_) > 0;
    return sample;
  }
  // Rounding errors of the probabilities go to the last lobe that exists.
  float rest = u_lobe - p_.diffuse;
  if (rest < p_.transmitted) return SampleBelow(-CosineDirection(ConcentricDisk(u)));
  rest -= p_.transmitted;
  if (p_.sheen > 0 && rest >= p_.facets + p_.coat) return SampleSheen(u);
  if (p_.coat > 0 && rest >= p_.facets) return SampleCoat(u);
  if (p_.facets <= 0) return {};
  return SampleFacets(std::min(rest / p_.facets, 0x1.fffffep-1f), u);
}

}  // namespace lumifold::render
