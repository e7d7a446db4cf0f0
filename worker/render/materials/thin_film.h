#pragma once

#include "worker/render/sampling/frame.h"

namespace lumifold::render {

/// The reflectance of a surface under a film about as thin as a wavelength of light: interference, integrated
/// over the spectrum. As KHR_materials_iridescence has it: Schlick's Fresnel at both faces of the film, no
/// polarisation, two orders of interference.
/// Source: Belcour & Barla 2017, "A Practical Extension to Microfacet Theory for the Modeling of Varying
/// Iridescence", sections 3 and 4.
class ThinFilm {
 public:
  ThinFilm() = default;
  /// thickness_nm: nanometres. outside_ior: of a coat above the film, else 1. base_f0: reflectance of the
  /// bare surface in air at normal incidence.
  ThinFilm(float thickness_nm, float film_ior, float outside_ior, Vec3 base_f0);

  /// In [0, 1]; `cosine` is that of the angle of incidence in air.
  Vec3 Reflectance(float cosine) const;

 private:
  float path_ = 0;  // 2 n d: the optical path difference at normal incidence, metres
  float film_ior_ = 1;
  float outside_ior_ = 1;
  float outer_f0_ = 0;     // of the film's outer face
  Vec3 inner_f0_;          // of its inner face
  Vec3 sign_ = {1, 1, 1};  // -1: one of the two faces inverts the wave, not both
};

}  // namespace lumifold::render
