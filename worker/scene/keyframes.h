#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "worker/scene/vec.h"

/// What lies between two keyframes (glTF 2.0, appendix C). Same bits on every machine.
namespace lumifold::scene {

/// The keyframes a time falls between; the same one twice before the first and after the last.
struct KeyframeSpan {
  size_t left = 0;
  size_t right = 0;
  float fraction = 0;  // of the way from left to right, in [0, 1)
  float seconds = 0;   // from left to right
};

/// `times` holds at least one time and never decreases.
KeyframeSpan FindKeyframes(const std::vector<float>& times, double time_seconds);

/// left + fraction * (right - left), number by number.
std::vector<float> LinearBetween(std::span<const float> left, std::span<const float> right, float fraction);

/// The shortest way round between unit quaternions (x, y, z, w), at constant speed; of unit length.
Vec4 SphericalBetween(Vec4 left, Vec4 right, float fraction);

/// The cubic through both values with these tangents (value per second), number by number.
std::vector<float> CubicBetween(const KeyframeSpan& span, std::span<const float> left,
                                std::span<const float> left_out_tangent,
                                std::span<const float> right_in_tangent, std::span<const float> right);

/// `q` of unit length; a zero stays zero.
Vec4 UnitQuaternion(Vec4 q);

}  // namespace lumifold::scene
