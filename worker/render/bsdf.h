#pragma once

#include "worker/render/albedo_table.h"
#include "worker/render/frame.h"
#include "worker/scene/scene.h"

namespace lumifold::render {

/// A material's values at one point, textures looked up.
struct SurfaceMaterial {
  Vec3 base_color = {1, 1, 1};
  float metallic = 0;
  float roughness = 1;
  float ior = 1.5f;
  float specular = 1;
  Vec3 specular_color = {1, 1, 1};
  float transmission = 0;
  bool thin = true;     // transmits straight on, as a pane does
  bool inside = false;  // the ray arrives from within the volume
  Vec3 sheen_color = {0, 0, 0};
  float sheen_roughness = 0;
  float clearcoat = 0;
  float clearcoat_roughness = 0;
  Vec3 coat_normal = {0, 0, 1};  // the coat's own shading normal, unit, on the viewer's side

  bool IsDiffuseOnly() const {
    return metallic <= 0 && specular <= 0 && transmission <= 0 && clearcoat <= 0 &&
           MaxComponent(sheen_color) <= 0;
  }
};

/// What one direction carries: the lobes apart, as the layers need them. Both include the cosine of the
/// direction.
struct BsdfValue {
  /// The diffuse lobe without its albedo: T * diffuse is the diffuse reflection. Its integral over directions
  /// is 1.
  float diffuse = 0;
  /// All other lobes, tint included.
  Vec3 specular = {0, 0, 0};
};

/// A direction drawn for the path to go on in.
struct BsdfSample {
  Vec3 wi;           // unit, world space
  BsdfValue weight;  // value over density
  float pdf = 0;     // per steradian, of all lobes together; 0 for a perfectly specular event
  bool valid = false;
  bool specular_event = false;
  bool transmitted = false;
  bool straight = false;  // through a clear pane: wi = -wo, perfectly specular
};

/// How a surface scatters light at one point towards `wo`. From the outside in: a clear coat, a sheen, and a
/// mixture of metal, of a diffuse base of albedo T under a GGX reflection, and of glass. Each layer leaves to
/// those below what it does not send back to the viewer, 1 - A(wo) with A its directional albedo; the diffuse
/// base's lobe is T * (1 - A(wi)) / (1 - mean A) * cos / pi under the GGX reflection, and so reciprocal with
/// it. Metal and glass make up for the light that single scattering loses between facets. All of it is
/// lossless; coat, sheen, metal and glass are not reciprocal for it.
/// Through solid glass radiance is carried over the squared index of its medium, which no boundary changes: a
/// path that comes out of the glass again has its radiance.
/// Sources: glTF 2.0 appendix B and the KHR_materials extensions (parameters and layers); Kelemen &
/// Szirmay-Kalos 2001 (coupling of coat and base); Walter et al. 2007 (refraction); Turquin 2019, "Practical
/// multiple scattering compensation for microfacet models".
class Bsdf {
 public:
  /// `normal` is the unit shading normal and `geometric` the unit face normal, both on wo's side; wo points
  /// away from the surface.
  Bsdf(const SurfaceMaterial& material, const AlbedoTable& table, Vec3 normal, Vec3 geometric, Vec3 wo);

  /// T, the exact multiplier of the diffuse lobe.
  Vec3 DiffuseAlbedo() const { return diffuse_albedo_; }
  bool HasDiffuse() const { return p_diffuse_ > 0; }
  /// About how much of even light all lobes together send to the viewer; 0 only where there are none.
  Vec3 Albedo() const;
  /// Whether a light sample can meet a lobe: false for perfect mirrors and glass.
  bool HasSmoothLobe() const {
    return p_diffuse_ > 0 || (p_facets_ > 0 && !mirror_) || (p_coat_ > 0 && !coat_mirror_) || p_sheen_ > 0;
  }

  /// How much of even light all lobes that are neither diffuse nor perfectly specular send to the viewer,
  /// above 0 in each channel where there is one.
  Vec3 SpecularAlbedo() const;
  /// GGX alpha of the lobe that reflects most, coat or what lies below; 1 where nothing but the diffuse one
  /// is.
  float SpecularAlpha() const;

  /// Whether perfect reflection and perfect transmission both leave from here, and no other mirror.
  bool IsSmoothGlass() const {
    return mirror_ && p_facets_ > 0 && glass_ > 0 && !(p_coat_ > 0 && coat_mirror_);
  }
  /// The probability that Sample() draws a perfectly specular event.
  float PerfectProbability() const { return (mirror_ ? p_facets_ : 0.0f) + (coat_mirror_ ? p_coat_ : 0.0f); }
  /// The perfectly specular events of metal, base and glass, with the whole of their weight and no
  /// probability in it; invalid where there is none.
  BsdfSample PerfectReflection() const;
  BsdfSample PerfectTransmission() const;

  /// The share of light that comes straight through a clear pane from behind; black for all else.
  Vec3 StraightTransmittance() const;

  /// The lobes' values towards unit wi (perfectly specular ones left out) and, in *pdf, the density of
  /// Sample() there.
  BsdfValue Evaluate(Vec3 wi, float* pdf) const;

  /// Draws a direction; `lobe` and `u` are random numbers in [0, 1).
  BsdfSample Sample(float lobe, Vec2 u) const;

 private:
  /// What a facet reflects and lets through.
  struct Split {
    Vec3 reflected;
    Vec3 transmitted = {0, 0, 0};
    float p_reflect = 1;
    float cos_t = 0;  // of the refracted ray to the facet's normal
  };

  float AddCoat(const SurfaceMaterial& material, Vec3 wo);
  float AddSheen(const SurfaceMaterial& material, float share);
  void AddBase(const SurfaceMaterial& material);
  void CompensateMetal(const SurfaceMaterial& material, DirectionalAlbedo seen);
  void Dim(float share);
  void AddGlass(const SurfaceMaterial& material, float share);
  void ChooseProbabilities();

  Split SplitAt(float cos_h) const;
  float DiffuseLobe(float cos_i) const;
  void EvaluateFacets(Vec3 wi, BsdfValue* value, float* pdf) const;
  void EvaluateTransmission(Vec3 wi, BsdfValue* value, float* pdf) const;
  void EvaluateCoat(Vec3 wi_world, BsdfValue* value, float* pdf) const;
  void EvaluateSheen(Vec3 wi, BsdfValue* value, float* pdf) const;

  bool IsDiffuseOnly() const { return p_diffuse_ >= 1 && cover_f90_ <= 0; }
  BsdfValue EvaluateDiffuse(Vec3 wi_world, float* pdf) const;
  BsdfSample SampleDiffuse(Vec2 u) const;
  BsdfSample SampleFacets(float lobe, Vec2 u) const;
  BsdfSample SampleSmooth(float lobe) const;
  BsdfSample Reflection(const Split& split) const;
  BsdfSample Transmission(const Split& split) const;
  BsdfSample SampleCoat(Vec2 u) const;
  BsdfSample SampleSheen(Vec2 u) const;
  BsdfSample Finish(Vec3 wi_world) const;

  const AlbedoTable* table_;
  Frame frame_;
  Vec3 geometric_;
  Vec3 wo_;  // local; not set where there is nothing but a diffuse lobe
  Vec3 diffuse_albedo_ = {0, 0, 0};

  // The facets: Schlick's reflection of metal and of what covers the diffuse base, and glass.
  float alpha_ = 1;
  bool mirror_ = false;
  bool thin_ = false;
  Vec3 f0_ = {0, 0, 0};
  Vec3 f90_ = {0, 0, 0};
  Vec3 facets_albedo_ = {0, 0, 0};  // of glass, about
  float cover_f0_ = 0;              // of what covers the diffuse base
  float cover_f90_ = 0;
  float cover_average_ = 0;
  float glass_ = 0;  // share, compensation included
  Vec3 glass_tint_ = {0, 0, 0};
  float eta_ = 1;  // far side over near side, of the Fresnel reflectance

  // The layers above, read only where their probability is above 0.
  float coat_alpha_ = 0;
  float coat_ = 0;
  float coat_albedo_ = 0;
  bool coat_mirror_ = false;
  Vec3 coat_normal_;
  Vec3 coat_wo_;  // in the coat's frame
  float sheen_alpha_ = 1;
  float sheen_albedo_ = 0;
  Vec3 sheen_color_;

  float p_diffuse_ = 0;
  float p_facets_ = 0;
  float p_coat_ = 0;
  float p_sheen_ = 0;
};

}  // namespace lumifold::render
