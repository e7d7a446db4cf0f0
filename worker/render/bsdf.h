#pragma once

#include "worker/render/frame.h"
#include "worker/render/microfacet.h"
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
  float spare = 0;   // what is left of the random number that chose the lobe: uniform in [0, 1), independent
                     // of all else here
  bool valid = false;
  bool specular_event = false;
  bool transmitted = false;
};

/// How a surface scatters light at one point towards `wo`: a diffuse base of albedo T under a GGX coat,
/// metal, or smooth glass. The base's lobe is T * (1 - A(wi)) / (1 - mean A) * cos / pi with A the coat's
/// directional albedo: reciprocal, without loss. Source: glTF 2.0 appendix B (parameters); Kelemen &
/// Szirmay-Kalos 2001 (coupling of coat and base).
class Bsdf {
 public:
  /// `normal` is the unit shading normal and `geometric` the unit face normal, both on wo's side; wo points
  /// away from the surface.
  Bsdf(const SurfaceMaterial& material, const AlbedoTable& table, Vec3 normal, Vec3 geometric, Vec3 wo);

  /// T, the exact multiplier of the diffuse lobe.
  Vec3 DiffuseAlbedo() const { return diffuse_albedo_; }
  bool HasDiffuse() const { return p_diffuse_ > 0; }
  /// Whether a light sample can meet a lobe: false for perfect mirrors and glass.
  bool HasSmoothLobe() const { return p_diffuse_ > 0 || (p_specular_ > 0 && !mirror_); }
  /// S, the directional albedo of all lobes that are neither diffuse nor perfectly specular; above 0 in every
  /// channel where such a lobe is.
  Vec3 SpecularAlbedo() const { return specular_albedo_; }
  /// The GGX alpha of the reflecting lobe; 1 where nothing but the diffuse one is.
  float SpecularAlpha() const { return p_specular_ > 0 ? alpha_ : 1.0f; }

  /// Whether perfect reflection and perfect transmission both leave from here.
  bool IsSmoothGlass() const { return mirror_ && p_specular_ > 0 && p_transmit_ > 0; }
  /// The probability that Sample() draws a perfectly specular event.
  float PerfectProbability() const { return mirror_ ? p_specular_ + p_transmit_ : 0.0f; }
  /// The perfectly specular events, with the whole of their weight and no probability in it; invalid where
  /// there is none.
  BsdfSample PerfectReflection() const;
  BsdfSample PerfectTransmission() const;

  /// The lobes' values towards unit wi (perfectly specular ones left out) and, in *pdf, the density of
  /// Sample() there.
  BsdfValue Evaluate(Vec3 wi, float* pdf) const;

  /// Draws a direction; `lobe` and `u` are random numbers in [0, 1).
  BsdfSample Sample(float lobe, Vec2 u) const;

 private:
  BsdfSample SampleLobe(float* lobe, Vec2 u) const;
  float DiffuseLobe(float cos_i) const;
  BsdfSample Finish(Vec3 wi_local) const;

  const AlbedoTable* table_;
  Frame frame_;
  Vec3 geometric_;
  Vec3 wo_;  // local
  Vec3 f0_;
  Vec3 diffuse_albedo_ = {0, 0, 0};
  Vec3 specular_albedo_ = {0, 0, 0};
  Vec3 mirror_reflectance_ = {0, 0, 0};
  Vec3 transmittance_ = {0, 0, 0};
  float coat_f0_ = 0;
  float coat_average_ = 0;
  float alpha_ = 1;
  float eta_ = 1;    // far side over near side; 1 for a thin pane
  float cos_t_ = 0;  // of the refracted ray
  bool mirror_ = false;
  float p_diffuse_ = 0;
  float p_specular_ = 0;
  float p_transmit_ = 0;
};

}  // namespace lumifold::render
