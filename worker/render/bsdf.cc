#include "worker/render/bsdf.h"

#include <algorithm>
#include <cmath>

#include "filter/image/color.h"
#include "filter/image/portable_math.h"
#include "worker/render/microfacet.h"
#include "worker/render/sheen.h"

namespace lumifold::render {
namespace {

/// Where there is any diffuse lobe it is drawn at least this often, so that D and I never rest on a few heavy
/// samples.
constexpr float kMinDiffuseProbability = 0.05f;

constexpr float kLeastCosine = 1e-4f;

/// A rough boundary between indices closer than this refracts by less than floats resolve: it is smooth.
constexpr float kLeastRefraction = 0.01f;

/// Of the coat of KHR_materials_clearcoat, ior 1.5.
constexpr float kCoatF0 = 0.04f;

float Brightness(Vec3 c) { return Luminance(c.x, c.y, c.z); }

Vec3 CosineDirection(Vec2 u) {
  const Vec2 disk = ConcentricDisk(u);
  return {disk.x, disk.y, std::sqrt(std::max(0.0f, 1.0f - disk.x * disk.x - disk.y * disk.y))};
}

/// Evenly over the hemisphere: the disk point's squared radius is uniform, and so is the cosine made of it.
Vec3 UniformDirection(Vec2 u) {
  const Vec2 disk = ConcentricDisk(u);
  const float r2 = std::min(disk.x * disk.x + disk.y * disk.y, 1.0f);
  const float stretch = std::sqrt(2.0f - r2);
  return {disk.x * stretch, disk.y * stretch, 1.0f - r2};
}

/// A perfectly specular event that was drawn with this probability.
BsdfSample Drawn(BsdfSample event, float probability) {
  event.weight.specular = event.weight.specular / probability;
  return event;
}

float NormalReflectance(float ior) {
  const float r = (ior - 1.0f) / (ior + 1.0f);
  return r * r;
}

Vec3 LocalOnUpperSide(const Frame& frame, Vec3 wo) {
  Vec3 local = frame.ToLocal(wo);
  local.z = std::max(local.z, kLeastCosine);
  return local;
}

Vec3 MirrorDirection(Vec3 wo, Vec3 h) { return h * (2.0f * Dot(wo, h)) - wo; }

float CoatFresnel(float coat, float cos_h) {
  return coat * SchlickFresnel({kCoatF0, 0, 0}, {1, 0, 0}, cos_h).x;
}

}  // namespace

Bsdf::Bsdf(const SurfaceMaterial& material, const AlbedoTable& table, Vec3 normal, Vec3 geometric, Vec3 wo)
    : table_(&table), frame_(normal), geometric_(geometric) {
  if (material.IsDiffuseOnly()) {
    diffuse_albedo_ = material.base_color;
    p_diffuse_ = MaxComponent(diffuse_albedo_) > 0 ? 1.0f : 0.0f;
    return;
  }
  wo_ = LocalOnUpperSide(frame_, wo);
  float share = 1;  // of the light that the layers so far leave to those below
  if (material.clearcoat > 0) share = AddCoat(material, wo);
  if (MaxComponent(material.sheen_color) > 0) share = AddSheen(material, share);
  AddBase(material);
  if (share < 1) Dim(share);
  if (material.transmission > 0 && material.metallic < 1) AddGlass(material, share);
  ChooseProbabilities();
}

/// Returns what is left for the layers below.
float Bsdf::AddCoat(const SurfaceMaterial& material, Vec3 wo) {
  coat_ = material.clearcoat;
  coat_alpha_ = material.clearcoat_roughness * material.clearcoat_roughness;
  coat_mirror_ = coat_alpha_ < kDeltaAlpha;
  coat_normal_ = material.coat_normal;
  coat_wo_ = LocalOnUpperSide(Frame(coat_normal_), wo);
  if (coat_mirror_) {
    coat_albedo_ = CoatFresnel(coat_, coat_wo_.z);
  } else {
    const DirectionalAlbedo seen = table_->Lookup(coat_wo_.z, coat_alpha_);
    coat_albedo_ = coat_ * (kCoatF0 * seen.scale + seen.bias);
  }
  return 1.0f - coat_albedo_;
}

/// The same below `share`.
float Bsdf::AddSheen(const SurfaceMaterial& material, float share) {
  sheen_alpha_ = std::max(material.sheen_roughness * material.sheen_roughness, kLeastSheenAlpha);
  sheen_color_ = material.sheen_color * share;
  sheen_albedo_ = table_->Sheen(wo_.z, sheen_alpha_);
  return share * (1.0f - std::min(MaxComponent(material.sheen_color) * sheen_albedo_, 1.0f));
}

/// Metal and the covered diffuse base.
void Bsdf::AddBase(const SurfaceMaterial& material) {
  alpha_ = material.roughness * material.roughness;
  mirror_ = alpha_ < kDeltaAlpha;
  const Vec3 f0 = material.specular_color * NormalReflectance(material.ior);
  const Vec3 cover =
      Vec3{std::min(f0.x, 1.0f), std::min(f0.y, 1.0f), std::min(f0.z, 1.0f)} * material.specular;
  cover_f0_ = MaxComponent(cover);
  cover_f90_ = material.specular;

  const float metal = material.metallic;
  const float covered = (1.0f - metal) * (1.0f - material.transmission);
  f0_ = cover * covered + material.base_color * metal;
  const float f90 = cover_f90_ * covered + metal;
  f90_ = {f90, f90, f90};

  const DirectionalAlbedo seen = f90 > 0 ? table_->Lookup(wo_.z, alpha_) : DirectionalAlbedo{};
  float cover_albedo = 0;
  if (cover_f90_ > 0) {
    const DirectionalAlbedo mean = table_->Average(alpha_);
    cover_average_ = cover_f0_ * mean.scale + cover_f90_ * mean.bias;
    cover_albedo = std::min(cover_f0_ * seen.scale + cover_f90_ * seen.bias, 1.0f);
  }
  diffuse_albedo_ = material.base_color * (covered * (1.0f - cover_albedo));
  facets_albedo_ = mirror_ ? SchlickFresnel(f0_, f90_, wo_.z) : f0_ * seen.scale + f90_ * seen.bias;
  if (metal > 0 && !mirror_) CompensateMetal(material, seen);
}

/// Metal's part of the albedo grows by 1 + F0 (1 - E) / E, with E the albedo at F0 = 1.
void Bsdf::CompensateMetal(const SurfaceMaterial& material, DirectionalAlbedo seen) {
  constexpr float kLeast = 1e-20f;  // black metal, seen along its normal, reflects nothing
  const float whole = seen.scale + seen.bias;
  const Vec3 b = material.base_color;
  const Vec3 made_up = b * (b * seen.scale + Vec3{seen.bias, seen.bias, seen.bias}) *
                       (material.metallic * (1.0f - whole) / whole);
  const Vec3 single = facets_albedo_;
  const Vec3 gain =
      Vec3{1, 1, 1} + Vec3{made_up.x / std::max(single.x, kLeast), made_up.y / std::max(single.y, kLeast),
                           made_up.z / std::max(single.z, kLeast)};
  f0_ *= gain;
  f90_ *= gain;
  facets_albedo_ *= gain;
}

/// Leaves metal and base `share` of the light.
void Bsdf::Dim(float share) {
  diffuse_albedo_ *= share;
  f0_ *= share;
  f90_ *= share;
  facets_albedo_ *= share;
}

/// The part that transmits; facets are those of the base.
void Bsdf::AddGlass(const SurfaceMaterial& material, float share) {
  thin_ = material.thin;
  eta_ = !thin_ && material.inside ? 1.0f / material.ior : material.ior;
  if (!thin_ && std::abs(material.ior - 1.0f) < kLeastRefraction) mirror_ = true;
  const float whole = (1.0f - material.metallic) * material.transmission * share;
  glass_ = whole;
  glass_tint_ = material.base_color;
  if (!mirror_) {
    const DirectionalAlbedo seen = table_->Lookup(wo_.z, alpha_);
    glass_ /= thin_ ? seen.scale + seen.bias : table_->Glass(material.ior, material.inside, wo_.z, alpha_);
  }
  float cos_t = 0;
  const float fresnel = DielectricFresnel(wo_.z, eta_, &cos_t);
  facets_albedo_ += (Vec3{fresnel, fresnel, fresnel} + glass_tint_ * (1.0f - fresnel)) * whole;
}

void Bsdf::ChooseProbabilities() {
  const float facets = Brightness(facets_albedo_);
  const float diffuse = Brightness(diffuse_albedo_);
  const float sheen = sheen_albedo_ > 0 ? Brightness(sheen_color_) * sheen_albedo_ : 0.0f;
  const float rest = facets + coat_albedo_ + sheen;
  if (diffuse + rest <= 0) return;
  p_diffuse_ = diffuse > 0 ? std::max(diffuse / (diffuse + rest), kMinDiffuseProbability) : 0.0f;
  if (rest <= 0) return;
  const float share = (1.0f - p_diffuse_) / rest;
  p_facets_ = facets * share;
  p_coat_ = coat_albedo_ * share;
  p_sheen_ = sheen * share;
}

Vec3 Bsdf::SpecularAlbedo() const {
  Vec3 albedo = {0, 0, 0};
  if (!mirror_) albedo = facets_albedo_;
  if (p_coat_ > 0 && !coat_mirror_) albedo += Vec3{coat_albedo_, coat_albedo_, coat_albedo_};
  if (p_sheen_ > 0) albedo += sheen_color_ * sheen_albedo_;
  return albedo;
}

Vec3 Bsdf::Albedo() const {
  Vec3 albedo = diffuse_albedo_ + facets_albedo_;
  if (p_coat_ > 0) albedo += Vec3{coat_albedo_, coat_albedo_, coat_albedo_};
  if (p_sheen_ > 0) albedo += sheen_color_ * sheen_albedo_;
  return albedo;
}

float Bsdf::SpecularAlpha() const {
  if (p_coat_ > p_facets_) return coat_alpha_;
  return p_facets_ > 0 ? alpha_ : 1.0f;
}

Vec3 Bsdf::StraightTransmittance() const {
  if (glass_ <= 0 || !thin_ || !mirror_) return {0, 0, 0};
  return SplitAt(wo_.z).transmitted;
}

Bsdf::Split Bsdf::SplitAt(float cos_h) const {
  Split split;
  split.reflected = SchlickFresnel(f0_, f90_, cos_h);
  if (glass_ <= 0) return split;
  float fresnel = DielectricFresnel(cos_h, eta_, &split.cos_t);
  if (thin_)
    fresnel = 2.0f * fresnel / (1.0f + fresnel);  // the light that goes to and fro between both faces
  const float reflected = glass_ * fresnel;
  split.reflected += {reflected, reflected, reflected};
  split.transmitted = glass_tint_ * (glass_ * (1.0f - fresnel));
  const float r = Brightness(split.reflected);
  const float t = Brightness(split.transmitted);
  if (t > 0) split.p_reflect = r / (r + t);
  return split;
}

float Bsdf::DiffuseLobe(float cos_i) const {
  float coupling = 1;
  if (cover_f90_ > 0) {
    const DirectionalAlbedo albedo = table_->Lookup(cos_i, alpha_);
    coupling = (1.0f - std::min(cover_f0_ * albedo.scale + cover_f90_ * albedo.bias, 1.0f)) /
               (1.0f - cover_average_);
  }
  return coupling * cos_i / kPi;
}

void Bsdf::EvaluateFacets(Vec3 wi, BsdfValue* value, float* pdf) const {
  const Vec3 h = Normalize(wi + wo_);
  const float cos_h = std::max(Dot(wo_, h), 1e-6f);
  const float lobe = GgxDensity(h, alpha_) * GgxVisibility(wi.z, wo_.z, alpha_) * wi.z;
  float probability = p_facets_;
  if (glass_ > 0) {
    const Split split = SplitAt(cos_h);
    value->specular += split.reflected * lobe;
    probability *= split.p_reflect;
  } else {
    value->specular += SchlickFresnel(f0_, f90_, cos_h) * lobe;
  }
  *pdf += probability * GgxVisibleDensity(wo_, h, alpha_) / (4.0f * cos_h);
}

/// Towards wi below the surface.
void Bsdf::EvaluateTransmission(Vec3 wi, BsdfValue* value, float* pdf) const {
  // A thin pane's second face undoes the bending: what goes through is the reflection's mirror image.
  const Vec3 h = thin_ ? Normalize(wo_ + Vec3{wi.x, wi.y, -wi.z}) : RefractionNormal(wo_, wi, eta_);
  const float cos_h = Dot(wo_, h);
  if (cos_h <= 0 || (!thin_ && Dot(wi, h) >= 0)) return;
  const Split split = SplitAt(cos_h);
  const float jacobian = thin_ ? 1.0f / (4.0f * cos_h) : RefractionJacobian(wo_, wi, h, eta_);
  const float density = GgxVisibleDensity(wo_, h, alpha_) * jacobian;
  value->specular += split.transmitted * (density * GgxShadowing(-wi.z, wo_.z, alpha_));
  *pdf += p_facets_ * (1.0f - split.p_reflect) * density;
}

void Bsdf::EvaluateCoat(Vec3 wi_world, BsdfValue* value, float* pdf) const {
  const Vec3 wi = Frame(coat_normal_).ToLocal(wi_world);
  if (wi.z <= 0) return;
  const Vec3 h = Normalize(wi + coat_wo_);
  const float cos_h = std::max(Dot(coat_wo_, h), 1e-6f);
  const float lobe = CoatFresnel(coat_, cos_h) * GgxDensity(h, coat_alpha_) *
                     GgxVisibility(wi.z, coat_wo_.z, coat_alpha_) * wi.z;
  value->specular += {lobe, lobe, lobe};
  *pdf += p_coat_ * GgxVisibleDensity(coat_wo_, h, coat_alpha_) / (4.0f * cos_h);
}

void Bsdf::EvaluateSheen(Vec3 wi, BsdfValue* value, float* pdf) const {
  value->specular += sheen_color_ * SheenLobe(wi, wo_, sheen_alpha_);
  *pdf += p_sheen_ / (2.0f * kPi);
}

BsdfValue Bsdf::EvaluateDiffuse(Vec3 wi_world, float* pdf) const {
  BsdfValue value;
  const float cos_i = Dot(wi_world, frame_.z);
  *pdf = cos_i > 0 && Dot(wi_world, geometric_) > 0 ? cos_i / kPi : 0.0f;
  value.diffuse = *pdf;
  return value;
}

BsdfValue Bsdf::Evaluate(Vec3 wi_world, float* pdf) const {
  if (IsDiffuseOnly()) return EvaluateDiffuse(wi_world, pdf);
  BsdfValue value;
  *pdf = 0;
  const Vec3 wi = frame_.ToLocal(wi_world);
  if (Dot(wi_world, geometric_) <= 0) {
    if (glass_ > 0 && !mirror_ && wi.z < 0) EvaluateTransmission(wi, &value, pdf);
    return value;
  }
  if (p_coat_ > 0 && !coat_mirror_) EvaluateCoat(wi_world, &value, pdf);
  if (wi.z <= 0) return value;
  if (p_diffuse_ > 0) {
    value.diffuse = DiffuseLobe(wi.z);
    *pdf += p_diffuse_ * wi.z / kPi;
  }
  if (p_facets_ > 0 && !mirror_) EvaluateFacets(wi, &value, pdf);
  if (p_sheen_ > 0) EvaluateSheen(wi, &value, pdf);
  return value;
}

BsdfSample Bsdf::Reflection(const Split& split) const {
  BsdfSample sample;
  sample.wi = frame_.ToWorld({-wo_.x, -wo_.y, wo_.z});
  sample.weight.specular = split.reflected;
  sample.specular_event = true;
  sample.valid = Dot(sample.wi, geometric_) > 0;
  return sample;
}

BsdfSample Bsdf::Transmission(const Split& split) const {
  BsdfSample sample;
  sample.wi = Normalize(frame_.ToWorld(thin_ ? -wo_ : Refract(wo_, {0, 0, 1}, eta_, split.cos_t)));
  sample.weight.specular = split.transmitted;
  sample.specular_event = true;
  sample.transmitted = true;
  sample.straight = thin_;
  sample.valid = Dot(sample.wi, geometric_) < 0;
  return sample;
}

BsdfSample Bsdf::PerfectReflection() const {
  return mirror_ && p_facets_ > 0 ? Reflection(SplitAt(wo_.z)) : BsdfSample{};
}

BsdfSample Bsdf::PerfectTransmission() const {
  if (!mirror_ || p_facets_ <= 0 || glass_ <= 0) return {};
  return Transmission(SplitAt(wo_.z));
}

BsdfSample Bsdf::SampleSmooth(float lobe) const {
  const Split split = SplitAt(wo_.z);
  if (lobe < split.p_reflect) return Drawn(Reflection(split), p_facets_ * split.p_reflect);
  return Drawn(Transmission(split), p_facets_ * (1.0f - split.p_reflect));
}

BsdfSample Bsdf::SampleFacets(float lobe, Vec2 u) const {
  if (mirror_) return SampleSmooth(lobe);
  const Vec3 h = SampleGgxVisibleNormal(wo_, alpha_, u);
  const Vec3 mirrored = MirrorDirection(wo_, h);
  const Split split = glass_ > 0 ? SplitAt(std::max(Dot(wo_, h), 1e-6f)) : Split{};
  if (lobe < split.p_reflect) return mirrored.z > 0 ? Finish(frame_.ToWorld(mirrored)) : BsdfSample{};
  const Vec3 wi = thin_ ? Vec3{mirrored.x, mirrored.y, -mirrored.z} : Refract(wo_, h, eta_, split.cos_t);
  if (wi.z >= 0) return {};
  const Vec3 wi_world = Normalize(frame_.ToWorld(wi));
  if (Dot(wi_world, geometric_) >= 0) return {};
  BsdfSample sample = Finish(wi_world);
  sample.transmitted = true;
  return sample;
}

BsdfSample Bsdf::SampleCoat(Vec2 u) const {
  const Frame frame(coat_normal_);
  if (!coat_mirror_) {
    const Vec3 wi = MirrorDirection(coat_wo_, SampleGgxVisibleNormal(coat_wo_, coat_alpha_, u));
    return wi.z > 0 ? Finish(frame.ToWorld(wi)) : BsdfSample{};
  }
  BsdfSample sample;
  sample.wi = frame.ToWorld({-coat_wo_.x, -coat_wo_.y, coat_wo_.z});
  const float weight = coat_albedo_ / p_coat_;
  sample.weight.specular = {weight, weight, weight};
  sample.specular_event = true;
  sample.valid = Dot(sample.wi, geometric_) > 0;
  return sample;
}

BsdfSample Bsdf::SampleSheen(Vec2 u) const { return Finish(frame_.ToWorld(UniformDirection(u))); }

BsdfSample Bsdf::Finish(Vec3 wi_world) const {
  BsdfSample sample;
  sample.wi = wi_world;
  const BsdfValue value = Evaluate(wi_world, &sample.pdf);
  if (sample.pdf <= 0) return sample;
  sample.weight.diffuse = value.diffuse / sample.pdf;
  sample.weight.specular = value.specular / sample.pdf;
  sample.valid = true;
  return sample;
}

/// The one lobe there is gives every direction in proportion to its value.
BsdfSample Bsdf::SampleDiffuse(Vec2 u) const {
  BsdfSample sample;
  const Vec3 wi = CosineDirection(u);
  sample.wi = frame_.ToWorld(wi);
  if (wi.z <= 0 || Dot(sample.wi, geometric_) <= 0) return sample;
  sample.pdf = wi.z / kPi;
  sample.weight.diffuse = 1;
  sample.valid = true;
  return sample;
}

BsdfSample Bsdf::Sample(float lobe, Vec2 u) const {
  if (IsDiffuseOnly()) return SampleDiffuse(u);
  if (lobe < p_diffuse_) return Finish(frame_.ToWorld(CosineDirection(u)));
  // The last lobe there is takes what rounding leaves over.
  const float rest = lobe - p_diffuse_;
  if (p_sheen_ > 0 && rest >= p_facets_ + p_coat_) return SampleSheen(u);
  if (p_coat_ > 0 && rest >= p_facets_) return SampleCoat(u);
  if (p_facets_ <= 0) return {};
  return SampleFacets(std::min(rest / p_facets_, 0x1.fffffep-1f), u);
}

}  // namespace lumifold::render
