#pragma once

#include <bit>
#include <cmath>
#include <cstdint>

/// Elementary functions that give the same bits on every machine. The C library selects other code on
/// processors with fused multiply-add, and its results then differ in the last bit; these functions use only
/// + - * / and sqrt, which IEEE 754 defines exactly. All take scalar floats, finite and in the stated range.
/// Errors are given in units in the last place (ulp) or absolute.
namespace lumifold {

inline constexpr float kPi = 3.14159265358979f;

/// e^x, within 2 ulp; 0 below -87, +infinity above 88.7. Branch-free, so that loops over it vectorise.
inline float Exp(float x) {
  constexpr float kLowest = -87.0f;
  constexpr float kHighest = 88.7f;
  constexpr float kLog2E = 1.44269504f;
  constexpr float kLn2High = 0.693359375f;  // few bits: n * kLn2High is exact
  constexpr float kLn2Low = -2.12194440e-4f;
  constexpr float kRounder =
      12582912.0f;  // 1.5 * 2^23: adding it rounds to a whole number, which is in the low bits
  float clamped = x < kLowest ? kLowest : x;
  clamped = clamped > kHighest ? kHighest : clamped;
  const float shifted = clamped * kLog2E + kRounder;
  const float n = shifted - kRounder;
  const float r = (clamped - n * kLn2High) - n * kLn2Low;
  float p = 1.9875691500e-4f;  // Cephes expf, minimax over [-ln2/2, ln2/2]
  p = p * r + 1.3981999507e-3f;
  p = p * r + 8.3334519073e-3f;
  p = p * r + 4.1665795894e-2f;
  p = p * r + 1.6666665459e-1f;
  p = p * r + 5.0000001201e-1f;
  const float mantissa = (p * (r * r) + r) + 1.0f;
  // 2^n in two factors: n reaches 128, and 2^128 is not a float.
  const int32_t exponent = std::bit_cast<int32_t>(shifted) - std::bit_cast<int32_t>(kRounder);
  const int32_t half = exponent >> 1;
  const float scale1 = std::bit_cast<float>((half + 127) << 23);
  const float scale2 = std::bit_cast<float>((exponent - half + 127) << 23);
  float result = (mantissa * scale1) * scale2;
  result = x < kLowest ? 0.0f : result;
  return x > kHighest ? std::bit_cast<float>(0x7f800000) : result;
}

/// Inverse hyperbolic sine, relative error below 6e-7; magnitudes over 1e18 count as 1e18. Branch-free, as
/// Exp.
inline float Asinh(float x) {
  constexpr float kLargest = 1e18f;  // its square is a float
  constexpr float kLn2High = 0.693359375f;
  constexpr float kLn2Low = -2.12194440e-4f;
  constexpr int32_t kSqrtHalf = 0x3f3504f3;  // bits of sqrt(1/2)
  const float magnitude = std::abs(x) < kLargest ? std::abs(x) : kLargest;
  // Logarithm of t >= 1, t = 2^exponent * (1 + f).
  const float t = magnitude + std::sqrt(1.0f + magnitude * magnitude);
  const int32_t bits = std::bit_cast<int32_t>(t);
  const int32_t exponent = (bits - kSqrtHalf) >> 23;
  const float f = std::bit_cast<float>(bits - exponent * (1 << 23)) - 1.0f;
  const float e = static_cast<float>(exponent);
  float p = 7.0376836292e-2f;  // Cephes logf, minimax over [sqrt(1/2) - 1, sqrt(2) - 1]
  p = p * f - 1.1514610310e-1f;
  p = p * f + 1.1676998740e-1f;
  p = p * f - 1.2420140846e-1f;
  p = p * f + 1.4249322787e-1f;
  p = p * f - 1.6668057665e-1f;
  p = p * f + 2.0000714765e-1f;
  p = p * f - 2.4999993993e-1f;
  p = p * f + 3.3333331174e-1f;
  const float square = f * f;
  const float logarithm = (f + ((p * f * square + e * kLn2Low) - 0.5f * square)) + e * kLn2High;
  // For small t - 1 the logarithm loses digits to rounding. The series' first omitted term is below 3e-8 of
  // the sum.
  const float m2 = magnitude * magnitude;
  const float series = magnitude * (1.0f - m2 * (1.0f / 6.0f - m2 * (3.0f / 40.0f - m2 * (15.0f / 336.0f))));
  const float value = magnitude < 0.125f ? series : logarithm;
  return std::copysign(value, x);
}

/// ln x for x > 0, within 2 ulp; -infinity at 0; NaN below.
float Log(float x);

/// x^y for x >= 0: Exp(y * Log(x)), 0^y = 0 for y > 0, 0^0 = 1. Relative error below 1e-5 for |y ln x| < 80.
float Pow(float x, float y);

/// sin and cos of x, absolute error below 5e-7 for |x| <= 1000.
void SinCos(float x, float* sin_x, float* cos_x);

/// arctangent of y/x in (-pi, pi], absolute error below 1e-6; 0 at the origin.
float Atan2(float y, float x);

/// arccosine of x clamped to [-1, 1], absolute error below 1e-6.
float Acos(float x);

}  // namespace lumifold
