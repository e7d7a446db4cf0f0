#include "worker/render/bsdf.h"

#include <algorithm>
#include <cmath>

#include "filter/image/color.h"
#include "filter/image/portable_math.h"

namespace lumifold::render {
namespace {

/// Where there is any diffuse lobe it is drawn at least this often, so that D and I never rest on a few heavy
/// samples.
constexpr float kMinDiffuseProbability = 0.05f;

float Brightness(Vec3 c) { return Luminance(c.x, c.y, c.z); }

Vec3 CosineDirection(Vec2 u) {
  const Vec2 disk = ConcentricDisk(u);
  return {disk.x, disk.y, std::sqrt(std::max(0.0f, 1.0f - disk.x * disk.x - disk.y * disk.y))};
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

}  // namespace

Bsdf::Bsdf(const SurfaceMaterial& material, const AlbedoTable& table, Vec3 normal, Vec3 geometric, Vec3 wo)
    : table_(&table), frame_(normal), geometric_(geometric) {
  wo_ = frame_.ToLocal(wo);
  wo_.z = std::max(wo_.z, 1e-4f);
  const bool glass = material.transmission > 0;
  alpha_ = glass ? 0.0f : material.roughness * material.roughness;
  mirror_ = alpha_ < kDeltaAlpha;
  const Vec3 dielectric_f0 = material.specular_color * (material.specular * NormalReflectance(material.ior));
  const Vec3 coat = {std::min(dielectric_f0.x, 1.0f), std::min(dielectric_f0.y, 1.0f),
                     std::min(dielectric_f0.z, 1.0f)};
  f0_ = Lerp(coat, material.base_color, material.metallic);
  coat_f0_ = MaxComponent(coat);
  // Without a specular lobe (KHR_materials_specular 0) nothing reflects at grazing angles either.
  const bool has_specular = MaxComponent(f0_) > 0;

  const float base_share = 1.0f - material.metallic;
  const DirectionalAlbedo seen = has_specular ? table.Lookup(wo_.z, alpha_) : DirectionalAlbedo{};
  float coat_albedo = 0;
  if (coat_f0_ > 0) {
    const DirectionalAlbedo mean = table.Average(alpha_);
    coat_average_ = coat_f0_ * mean.scale + mean.bias;
    coat_albedo = std::min(coat_f0_ * seen.scale + seen.bias, 1.0f);
  }
  diffuse_albedo_ =
      material.base_color * (base_share * (1.0f - material.transmission) * (1.0f - coat_albedo));

  if (mirror_) mirror_reflectance_ = has_specular ? SchlickFresnel(f0_, wo_.z) : Vec3{0, 0, 0};
  if (glass) {
    eta_ = material.inside ? 1.0f / material.ior : material.ior;
    float fresnel = DielectricFresnel(wo_.z, eta_, &cos_t_);
    if (material.thin) {
      fresnel = 2.0f * fresnel / (1.0f + fresnel);  // the light that goes to and fro between both faces
      eta_ = 1;
    }
    const Vec3 clear = Vec3{fresnel, fresnel, fresnel};
    mirror_reflectance_ = Lerp(clear, mirror_reflectance_, material.metallic);
    transmittance_ = material.base_color * (base_share * material.transmission * (1.0f - fresnel));
  }

  const float diffuse = Brightness(diffuse_albedo_);
  if (!mirror_) specular_albedo_ = f0_ * seen.scale + Vec3{1, 1, 1} * seen.bias;
  const float specular = Brightness(mirror_ ? mirror_reflectance_ : specular_albedo_);
  const float transmit = Brightness(transmittance_);
  const float total = diffuse + specular + transmit;
  if (total <= 0) return;
  p_diffuse_ = diffuse > 0 ? std::max(diffuse / total, kMinDiffuseProbability) : 0.0f;
  const float rest = specular + transmit;
  if (rest > 0) {
    p_specular_ = (1.0f - p_diffuse_) * specular / rest;
    p_transmit_ = (1.0f - p_diffuse_) * transmit / rest;
  }
}

float Bsdf::DiffuseLobe(float cos_i) const {
  float coupling = 1;
  if (coat_f0_ > 0) {
    const DirectionalAlbedo albedo = table_->Lookup(cos_i, alpha_);
    coupling = (1.0f - std::min(coat_f0_ * albedo.scale + albedo.bias, 1.0f)) / (1.0f - coat_average_);
  }
  return coupling * cos_i / kPi;
}

BsdfValue Bsdf::Evaluate(Vec3 wi_world, float* pdf) const {
  BsdfValue value;
  *pdf = 0;
  const Vec3 wi = frame_.ToLocal(wi_world);
  if (wi.z <= 0 || Dot(wi_world, geometric_) <= 0) return value;
  if (p_diffuse_ > 0) {
    value.diffuse = DiffuseLobe(wi.z);
    *pdf += p_diffuse_ * wi.z / kPi;
  }
  if (p_specular_ > 0 && !mirror_) {
    const Vec3 h = Normalize(wi + wo_);
    const float cos_h = std::max(Dot(wo_, h), 1e-6f);
    const float density = GgxDensity(h, alpha_);
    value.specular = SchlickFresnel(f0_, cos_h) * (density * GgxVisibility(wi.z, wo_.z, alpha_) * wi.z);
    *pdf += p_specular_ * GgxVisibleDensity(wo_, h, alpha_) / (4.0f * cos_h);
  }
  return value;
}

BsdfSample Bsdf::PerfectReflection() const {
  BsdfSample sample;
  if (!mirror_ || p_specular_ <= 0) return sample;
  sample.wi = frame_.ToWorld({-wo_.x, -wo_.y, wo_.z});
  sample.weight.specular = mirror_reflectance_;
  sample.specular_event = true;
  sample.valid = Dot(sample.wi, geometric_) > 0;
  return sample;
}

BsdfSample Bsdf::PerfectTransmission() const {
  BsdfSample sample;
  if (!mirror_ || p_transmit_ <= 0) return sample;
  const Vec3 wi = eta_ == 1.0f ? -wo_ : Vec3{-wo_.x / eta_, -wo_.y / eta_, -cos_t_};
  sample.wi = Normalize(frame_.ToWorld(wi));
  sample.weight.specular = transmittance_;
  sample.specular_event = true;
  sample.transmitted = true;
  sample.valid = Dot(sample.wi, geometric_) < 0;
  return sample;
}

BsdfSample Bsdf::Finish(Vec3 wi_local) const {
  BsdfSample sample;
  if (wi_local.z <= 0) return sample;
  sample.wi = frame_.ToWorld(wi_local);
  const BsdfValue value = Evaluate(sample.wi, &sample.pdf);
  if (sample.pdf <= 0) return sample;
  sample.weight.diffuse = value.diffuse / sample.pdf;
  sample.weight.specular = value.specular / sample.pdf;
  sample.valid = true;
  return sample;
}

BsdfSample Bsdf::SampleLobe(float* lobe, Vec2 u) const {
  if (*lobe < p_diffuse_) {
    *lobe /= p_diffuse_;
    return Finish(CosineDirection(u));
  }
  const float past_diffuse = *lobe - p_diffuse_;
  if (p_transmit_ > 0 && past_diffuse >= p_specular_) {
    *lobe = (past_diffuse - p_specular_) / p_transmit_;
    return Drawn(PerfectTransmission(), p_transmit_);
  }
  if (p_specular_ <= 0) return {};
  *lobe = past_diffuse / p_specular_;
  if (mirror_) return Drawn(PerfectReflection(), p_specular_);
  const Vec3 h = SampleGgxVisibleNormal(wo_, alpha_, u);
  return Finish(h * (2.0f * Dot(wo_, h)) - wo_);
}

BsdfSample Bsdf::Sample(float lobe, Vec2 u) const {
  BsdfSample sample = SampleLobe(&lobe, u);
  sample.spare = std::min(lobe, 0x1.fffffep-1f);
  return sample;
}

}  // namespace lumifold::render
