#pragma once

#include "worker/render/materials/albedo_table.h"
#include "worker/render/materials/microfacet.h"
#include "worker/render/materials/thin_film.h"
#include "worker/render/sampling/frame.h"
#include "worker/scene/scene.h"

namespace lumifold::render {

/// A material's values at one point, with textures applied.
struct SurfaceMaterial {
  /// What few materials have.
  struct Rare {
    Vec3 anisotropy = {0, 0, 0};  // direction of the greater roughness, as long as it is strong
    float iridescence = 0;        // weight of the film
    float film_ior = 1.3f;
    float film_thickness_nm = 0;
    float diffuse_transmission = 0;  // part of the diffuse base's light
    Vec3 diffuse_transmission_color = {1, 1, 1};
    float dispersion = 0;                // of scene::Material; the BSDF itself has one index
    Vec3 refraction_weight = {1, 1, 1};  // of refracted light: Wavelength::weight
  };
  Vec3 base_color = {1, 1, 1};
  float metallic = 0;
  float roughness = 1;
  float ior = 1.5f;
  float specular = 1;  // factor of KHR_materials_specular
  Vec3 specular_color = {1, 1, 1};
  float transmission = 0;
  bool thin = true;     // transmits without refraction, like a pane
  bool inside = false;  // the ray comes from inside the volume
  Vec3 sheen_color = {0, 0, 0};
  float sheen_roughness = 0;
  float clearcoat = 0;
  float clearcoat_roughness = 0;
  Vec3 coat_normal = {0, 0, 1};  // the coat's own shading normal, unit, on the viewer's side
  Rare rare;

  /// Whether there are no lobes but the diffuse one and rough reflection by metal and dielectric layer.
  bool IsBaseOnly() const;
  /// Of the microfacets of metal, dielectric layer and glass; x is the direction of the anisotropy.
  GgxAlpha Alpha() const;
  bool IsDiffuseOnly() const {
    return metallic <= 0 && specular <= 0 && transmission <= 0 && rare.diffuse_transmission <= 0 &&
           clearcoat <= 0 && MaxComponent(sheen_color) <= 0;
  }
};

/// What a material alone determines of metal and of the diffuse base under its dielectric layer. Lanes read
/// it by fours.
struct BaseMaterial {
  Vec3 base_color;
  float metallic = 0;
  Vec3 f0;  // of metal and layer together
  float f90 = 0;
  float alpha = 1;
  float root_alpha = 1;
  float dielectric_f0 = 0;  // of the layer
  float dielectric_f90 = 0;
  float mean_albedo = 0;
  float base_weight = 0;  // of the diffuse base
  float unused[2] = {};

  BaseMaterial() = default;
  BaseMaterial(const SurfaceMaterial& material, const AlbedoTable& table);
};

/// The BSDF's value for one direction, times the direction's cosine; split by lobe, as the layers need it.
struct BsdfValue {
  /// The diffuse lobe without its albedo: T * diffuse is the diffuse reflection. It integrates to 1 over
  /// directions.
  float diffuse = 0;
  /// The sum of the glossy and delta lobes, tint included.
  Vec3 non_diffuse = {0, 0, 0};
};

/// A sampled direction in which the path continues.
struct BsdfSample {
  Vec3 wi;           // unit, world space
  BsdfValue weight;  // value over density
  float pdf = 0;     // per steradian, of all lobes together; 0 for a delta event
  bool valid = false;
  bool is_delta = false;  // a delta event: reflection or transmission at a perfectly smooth boundary
  bool transmitted = false;
  bool straight = false;  // a delta event through a clear pane: wi = -wo
};

/// Scattering at one surface point towards `wo`. Lobes are diffuse, glossy (rough reflection, rough or
/// diffuse transmission, sheen) or delta (perfectly smooth boundaries). Layers from the outside in: a clear
/// coat; a sheen; a mixture of metal, of a diffuse base of albedo T under a dielectric GGX layer, and glass.
/// Each layer passes the fraction 1 - A(wo) of the light to the layers below, with A its directional albedo.
/// The diffuse lobe is T * (1 - A(wi)) / (1 - mean A) * cos / pi under the dielectric layer, which makes the
/// two reciprocal; the diffuse transmission is the same on the other side, in its own colour. Metal and glass
/// compensate for the energy that single scattering loses between microfacets. All layers conserve energy;
/// coat, sheen, metal, glass and anisotropic layers are not reciprocal.
/// Inside solid glass, paths carry radiance over the squared index of the medium, which no boundary changes:
/// after a path has left the glass it carries radiance again.
/// Sources: glTF 2.0 appendix B and the KHR_materials extensions (parameters and layers); Kelemen &
/// Szirmay-Kalos 2001 (coupling of dielectric layer and base); Walter et al. 2007 (refraction); Turquin 2019,
/// "Practical multiple scattering compensation for microfacet models".
class Bsdf {
 public:
  /// `normal` is the unit shading normal, `geometric` the unit face normal, both on wo's side. wo points away
  /// from the surface.
  Bsdf(const SurfaceMaterial& material, const AlbedoTable& table, Vec3 normal, Vec3 geometric, Vec3 wo);

  /// T, the exact multiplier of the diffuse lobe.
  Vec3 DiffuseAlbedo() const { return diffuse_albedo_; }
  bool HasDiffuse() const { return p_.diffuse > 0; }
  /// Approximate directional albedo of all lobes together; 0 only if there are none.
  Vec3 Albedo() const;
  /// Whether Evaluate() can be above 0: false for perfect mirrors and smooth glass.
  bool HasNonDeltaLobe() const {
    return p_.diffuse > 0 || p_.transmitted > 0 || (p_.facets > 0 && !facets_.mirror) ||
           (p_.coat > 0 && !coat_.mirror) || p_.sheen > 0;
  }

  /// S: the directional albedo of all glossy lobes; above 0 in each channel in which there is one.
  Vec3 GlossyAlbedo() const;
  /// GGX alpha of the lobe that reflects most, either the coat's or the one below; 1 if all is diffuse.
  float ReflectionAlpha() const;

  /// Whether there are both a delta reflection and a delta transmission, and no mirror-like coat.
  bool IsSmoothGlass() const {
    return facets_.mirror && p_.facets > 0 && glass_.weight > 0 && !(p_.coat > 0 && coat_.mirror);
  }
  /// The probability that Sample() returns a delta event.
  float DeltaProbability() const {
    return (facets_.mirror ? p_.facets : 0.0f) + (coat_.mirror ? p_.coat : 0.0f);
  }
  /// The delta events of metal, base and glass. Their weight is the reflectance or transmittance, not divided
  /// by a probability; invalid if there is no such event.
  BsdfSample DeltaReflection() const;
  BsdfSample DeltaTransmission() const;

  /// Transmittance of a clear pane for light from straight behind; black for all other materials.
  Vec3 StraightTransmittance() const;

  /// The value of all lobes except delta lobes towards unit wi; *pdf receives the density of Sample() there.
  BsdfValue Evaluate(Vec3 wi, float* pdf) const;

  /// Samples a direction; `u_lobe` (selects the lobe) and `u` are random numbers in [0, 1).
  BsdfSample Sample(float u_lobe, Vec2 u) const;

 private:
  /// Reflectance and transmittance of one microfacet.
  struct Fresnel {
    Vec3 reflected;
    Vec3 transmitted = {0, 0, 0};
    float p_reflect = 1;
    float cos_t = 0;  // between the refracted ray and the microfacet's normal
  };

  /// Microfacets of metal and of the dielectric layer (Schlick's Fresnel), and of glass.
  struct Facets {
    GgxAlpha alpha;
    bool mirror = false;
    Vec3 f0 = {0, 0, 0};
    Vec3 f90 = {0, 0, 0};
    Vec3 albedo = {0, 0, 0};  // approximate for glass
  };
  /// A film on metal, dielectric layer and glass.
  struct Film {
    float weight = 0;  // 0: there is none
    ThinFilm on_dielectric;
    ThinFilm on_metal;
    float dielectric = 0;    // factor of the reflectance of the dielectric layer,
    float metallic = 0;      // and of metal's,
    Vec3 scale = {1, 1, 1};  // and of both
    float mean_cosine = 1;   // of the microfacets that reflect towards the viewer

    Vec3 Reflectance(float cosine) const {
      Vec3 sum = {0, 0, 0};
      if (dielectric > 0) sum += on_dielectric.Reflectance(cosine) * dielectric;
      if (metallic > 0) sum += on_metal.Reflectance(cosine) * metallic;
      return sum * scale;
    }
  };
  /// The dielectric layer over the diffuse base.
  struct Dielectric {
    float f0 = 0;
    float f90 = 0;
    float mean_albedo = 0;
  };
  struct Glass {
    float weight = 0;  // energy compensation included
    Vec3 tint = {0, 0, 0};
    float eta = 1;  // index of the far side over that of the near side
    bool thin = false;
  };
  /// Read only if its probability is above 0.
  struct Coat {
    GgxAlpha alpha;
    float weight = 0;
    float albedo = 0;
    bool mirror = false;
    Vec3 normal;
    Vec3 wo;  // in the coat's frame
  };
  /// Read only if its probability is above 0.
  struct Sheen {
    float alpha = 1;
    float albedo = 0;
    Vec3 color;
  };
  /// Of sampling each lobe.
  struct Probabilities {
    float diffuse = 0;
    float transmitted = 0;  // diffuse, to the other side
    float facets = 0;
    float coat = 0;
    float sheen = 0;
  };

  float AddCoat(const SurfaceMaterial& material, Vec3 wo);
  float AddSheen(const SurfaceMaterial& material, float share);
  void AddBase(const SurfaceMaterial& material);
  float AddFilm(const SurfaceMaterial& material, const BaseMaterial& base, DirectionalAlbedo seen,
                float dielectric_albedo);
  void CompensateMetal(const SurfaceMaterial& material, DirectionalAlbedo seen);
  void ScaleMetalAndBase(float share);
  void AddGlass(const SurfaceMaterial& material, float share);
  void ChooseProbabilities();

  Vec3 GlassReflectance(float cos_h, float* cos_t) const;
  Fresnel FresnelAt(float cos_h) const;
  float DiffuseLobe(float cos_i) const;
  void EvaluateFacets(Vec3 wi, BsdfValue* value, float* pdf) const;
  void EvaluateTransmission(Vec3 wi, BsdfValue* value, float* pdf) const;
  void EvaluateCoat(Vec3 wi_world, BsdfValue* value, float* pdf) const;
  void EvaluateSheen(Vec3 wi, BsdfValue* value, float* pdf) const;

  bool IsDiffuseOnly() const { return p_.diffuse >= 1 && dielectric_.f90 <= 0; }
  BsdfSample SampleFacets(float u_lobe, Vec2 u) const;
  BsdfSample SampleDelta(float u_lobe) const;
  BsdfSample Reflection(const Fresnel& fresnel) const;
  BsdfSample Transmission(const Fresnel& fresnel) const;
  BsdfSample SampleCoat(Vec2 u) const;
  BsdfSample SampleSheen(Vec2 u) const;
  BsdfSample SampleBelow(Vec3 wi) const;
  BsdfSample SampleTowards(Vec3 wi_world) const;

  const AlbedoTable* table_;
  Frame frame_;
  Vec3 geometric_;
  Vec3 wo_;  // in the shading frame; not set if the only lobe is diffuse
  Vec3 diffuse_albedo_ = {0, 0, 0};
  Vec3 transmitted_albedo_ = {0, 0, 0};  // of the diffuse lobe on the other side

  Facets facets_;
  Film film_;
  Dielectric dielectric_;
  Glass glass_;
  Coat coat_;
  Sheen sheen_;
  Probabilities p_;
};

}  // namespace lumifold::render
