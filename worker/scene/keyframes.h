#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "worker/scene/vec.h"

/// Interpolation between keyframes (glTF 2.0, appendix C). Same bits on every machine.
namespace lumifold::scene {

/// The two keyframes around a time; before the first and after the last keyframe both are that one.
struct KeyframeSpan {
  size_t left = 0;
  size_t right = 0;
  float fraction = 0;  // position from left to right, in [0, 1)
  float seconds = 0;   // from left to right
};

/// `times` must not be empty and must not decrease.
KeyframeSpan FindKeyframes(const std::vector<float>& times, double time_seconds);

/// left + fraction * (right - left), for each component.
std::vector<float> LinearBetween(std::span<const float> left, std::span<const float> right, float fraction);

/// Spherical linear interpolation between unit quaternions (x, y, z, w) along the shorter arc; unit length.
Vec4 SphericalBetween(Vec4 left, Vec4 right, float fraction);

/// Cubic Hermite interpolation with these tangents (value per second), for each component.
std::vector<float> CubicBetween(const KeyframeSpan& span, std::span<const float> left,
                                std::span<const float> left_out_tangent,
                                std::span<const float> right_in_tangent, std::span<const float> right);

/// `q` scaled to unit length; zero is returned unchanged.
Vec4 UnitQuaternion(Vec4 q);

}  // namespace lumifold::scene
