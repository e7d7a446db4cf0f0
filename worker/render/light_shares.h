#pragma once

#include <vector>

namespace lumifold::render {

/// Power of each light of a scene, as luminance.
struct LightPowers {
  std::vector<double> finite;
  std::vector<double> infinite;

  bool AllZero() const;
};

/// The shares of samples, finite lights first: in proportion to power. They sum to 1; a light of power 0 has
/// none. If there are both finite and infinite lights, each kind has at least a quarter, because the power of
/// infinite lights says little about how much of it gets indoors.
///
/// Up to kFewLights lights have shares of whole parts, at least one each: four times as many parts as there
/// are lights, rounded up to a power of two. Then the stratified numbers of a pixel select each light equally
/// often in every pixel: otherwise a pixel where one light is occluded varies by how often the other was
/// selected.
std::vector<double> LightShares(const LightPowers& powers);

inline constexpr int kFewLights = 8;

}  // namespace lumifold::render
