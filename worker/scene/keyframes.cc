#include "worker/scene/keyframes.h"

#include <algorithm>
#include <cmath>

#include "filter/image/portable_math.h"

namespace lumifold::scene {
namespace {

Vec4 Blend(Vec4 a, float weight_a, Vec4 b, float weight_b) {
  return {a.x * weight_a + b.x * weight_b, a.y * weight_a + b.y * weight_b, a.z * weight_a + b.z * weight_b,
          a.w * weight_a + b.w * weight_b};
}

float Norm(Vec4 q) { return std::sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w); }

float Sine(float x) {
  float sine = 0, cosine = 1;
  SinCos(x, &sine, &cosine);
  return sine;
}

}  // namespace

KeyframeSpan FindKeyframes(const std::vector<float>& times, double time_seconds) {
  const auto after = std::upper_bound(times.begin(), times.end(), time_seconds,
                                      [](double time, float key) { return time < double{key}; });
  if (after == times.begin()) return {0, 0, 0, 0};
  const auto right = static_cast<size_t>(after - times.begin());
  if (after == times.end()) return {right - 1, right - 1, 0, 0};
  const double seconds = double{times[right]} - double{times[right - 1]};
  const auto fraction = static_cast<float>((time_seconds - double{times[right - 1]}) / seconds);
  return {right - 1, right, fraction, static_cast<float>(seconds)};
}

std::vector<float> LinearBetween(std::span<const float> left, std::span<const float> right, float fraction) {
  std::vector<float> values(left.size());
  for (size_t i = 0; i < values.size(); ++i) values[i] = left[i] * (1.0f - fraction) + right[i] * fraction;
  return values;
}

Vec4 UnitQuaternion(Vec4 q) {
  const float largest = std::max({std::fabs(q.x), std::fabs(q.y), std::fabs(q.z), std::fabs(q.w)});
  if (!(largest > 0)) return q;
  // Scaled to a largest component of 1 first, so that squares neither overflow nor underflow.
  const Vec4 scaled = {q.x / largest, q.y / largest, q.z / largest, q.w / largest};
  const float norm = Norm(scaled);
  return {scaled.x / norm, scaled.y / norm, scaled.z / norm, scaled.w / norm};
}

Vec4 SphericalBetween(Vec4 left, Vec4 right, float fraction) {
  // Below this angle linear interpolation is as accurate, and the quotient of sines loses precision.
  constexpr float kSmallAngle = 0.02f;
  const float dot = left.x * right.x + left.y * right.y + left.z * right.z + left.w * right.w;
  const float sign = dot < 0 ? -1.0f : 1.0f;  // q and -q are the same rotation: use the nearer one
  // Half the angle from its tangent: the arccosine of a dot product near 1 would be mostly rounding error.
  const float angle = 2 * Atan2(Norm(Blend(left, 1, right, -sign)), Norm(Blend(left, 1, right, sign)));
  if (angle < kSmallAngle) return UnitQuaternion(Blend(left, 1 - fraction, right, sign * fraction));
  const float sine = Sine(angle);
  return UnitQuaternion(
      Blend(left, Sine((1 - fraction) * angle) / sine, right, sign * Sine(fraction * angle) / sine));
}

std::vector<float> CubicBetween(const KeyframeSpan& span, std::span<const float> left,
                                std::span<const float> left_out_tangent,
                                std::span<const float> right_in_tangent, std::span<const float> right) {
  const float t = span.fraction, t2 = t * t, t3 = t2 * t;
  const float at_left = 2 * t3 - 3 * t2 + 1, at_right = 3 * t2 - 2 * t3;
  const float leaving = span.seconds * (t3 - 2 * t2 + t), arriving = span.seconds * (t3 - t2);
  std::vector<float> values(left.size());
  for (size_t i = 0; i < values.size(); ++i) {
    values[i] = at_left * left[i] + leaving * left_out_tangent[i] + at_right * right[i] +
                arriving * right_in_tangent[i];
  }
  return values;
}

}  // namespace lumifold::scene
