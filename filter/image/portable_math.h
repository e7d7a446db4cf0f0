#pragma once

#include <bit>
#include <cstdint>

/// Elementary functions with the same bits on every machine. The C library picks other code where the
/// processor has fused multiply-add, and its results then differ in the last bit; these use only + - * / and
/// sqrt, which IEEE 754 fixes. All are for float (scalar), finite arguments of the stated range; accuracy is
/// stated in units in the last place (ulp) or absolute.
namespace lumifold {

inline constexpr float kPi = 3.14159265358979f;

/// e^x, within 2 ulp; 0 below -87, +infinity above 88.7. Without branches, so that loops over it become
/// vector code.
inline float Exp(float x) {
  constexpr float kLowest = -87.0f;
  constexpr float kHighest = 88.7f;
  constexpr float kLog2E = 1.44269504f;
  constexpr float kLn2High = 0.693359375f;  // few bits: n * kLn2High is exact
  constexpr float kLn2Low = -2.12194440e-4f;
  constexpr float kRounder =
      12582912.0f;  // 1.5 * 2^23: adding it rounds to a whole number and leaves that in the low bits
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
  // 2^n in two steps: n reaches 128, whose power alone is not a float.
  const int32_t exponent = std::bit_cast<int32_t>(shifted) - std::bit_cast<int32_t>(kRounder);
  const int32_t half = exponent >> 1;
  const float scale1 = std::bit_cast<float>((half + 127) << 23);
  const float scale2 = std::bit_cast<float>((exponent - half + 127) << 23);
  float result = (mantissa * scale1) * scale2;
  result = x < kLowest ? 0.0f : result;
  return x > kHighest ? std::bit_cast<float>(0x7f800000) : result;
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
