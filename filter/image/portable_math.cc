#include "filter/image/portable_math.h"

#include <cmath>
#include <limits>

// Inner steps are in double: a short polynomial is then accurate to far below a float's last place.
namespace lumifold {
namespace {

constexpr double kPiDouble = 3.14159265358979323846;

/// ln x for a positive, normal double.
double LogDouble(double x) {
  constexpr double kLn2 = 0.693147180559945309417;
  constexpr double kSqrt2 = 1.41421356237309504880;
  const uint64_t bits = std::bit_cast<uint64_t>(x);
  int exponent = static_cast<int>(bits >> 52) - 1023;
  double mantissa = std::bit_cast<double>((bits & 0x000fffffffffffffu) | 0x3ff0000000000000u);
  if (mantissa > kSqrt2) {
    mantissa *= 0.5;
    ++exponent;
  }
  // ln m = 2 artanh t, |t| < 0.172: the first omitted term is below 1e-11 of the sum.
  const double t = (mantissa - 1.0) / (mantissa + 1.0);
  const double t2 = t * t;
  double series = 1.0 / 13.0;
  for (int k = 11; k >= 1; k -= 2) series = series * t2 + 1.0 / k;
  return exponent * kLn2 + 2.0 * t * series;
}

/// arctangent of t in [0, 1].
double AtanUnit(double t) {
  constexpr double kTanPi8 = 0.41421356237309504880;
  const bool is_upper = t > kTanPi8;
  const double u = is_upper ? (t - 1.0) / (t + 1.0) : t;
  const double u2 = u * u;
  double p = 8.05374449538e-2;  // Cephes atanf, minimax over |u| <= tan(pi/8)
  p = p * u2 - 1.38776856032e-1;
  p = p * u2 + 1.99777106478e-1;
  p = p * u2 - 3.33329491539e-1;
  return p * u2 * u + u + (is_upper ? kPiDouble / 4 : 0.0);
}

double Atan2Double(double y, double x) {
  const double ax = x < 0 ? -x : x;
  const double ay = y < 0 ? -y : y;
  if (ax == 0 && ay == 0) return 0;
  double angle = ay > ax ? kPiDouble / 2 - AtanUnit(ax / ay) : AtanUnit(ay / ax);
  if (x < 0) angle = kPiDouble - angle;
  return y < 0 ? -angle : angle;
}

}  // namespace

float Log(float x) {
  if (x == 0) return -std::numeric_limits<float>::infinity();
  if (!(x > 0)) return std::numeric_limits<float>::quiet_NaN();
  if (x > std::numeric_limits<float>::max()) return x;
  return static_cast<float>(LogDouble(x));
}

float Pow(float x, float y) {
  if (y == 0) return 1;
  if (x == 0) return y > 0 ? 0.0f : std::numeric_limits<float>::infinity();
  return Exp(y * Log(x));
}

void SinCos(float x, float* sin_x, float* cos_x) {
  constexpr double kRounder = 6755399441055744.0;  // 1.5 * 2^52: adding it rounds to a whole number
  const double quarter_turns = (x * (2.0 / kPiDouble) + kRounder) - kRounder;
  const double r = x - quarter_turns * (kPiDouble / 2);
  const double r2 = r * r;
  // Taylor over |r| <= pi/4: the first omitted terms are below 1e-11.
  const double s = r * (1 - r2 / 6 * (1 - r2 / 20 * (1 - r2 / 42 * (1 - r2 / 72 * (1 - r2 / 110)))));
  const double c =
      1 - r2 / 2 * (1 - r2 / 12 * (1 - r2 / 30 * (1 - r2 / 56 * (1 - r2 / 90 * (1 - r2 / 132)))));
  const int64_t quadrant = static_cast<int64_t>(quarter_turns) & 3;
  const bool is_swapped = (quadrant & 1) != 0;
  const double sine = is_swapped ? c : s;
  const double cosine = is_swapped ? s : c;
  *sin_x = static_cast<float>(quadrant >= 2 ? -sine : sine);
  *cos_x = static_cast<float>(quadrant == 1 || quadrant == 2 ? -cosine : cosine);
}

float Atan2(float y, float x) { return static_cast<float>(Atan2Double(y, x)); }

float Acos(float x) {
  const double c = x < -1 ? -1.0 : (x > 1 ? 1.0 : static_cast<double>(x));
  return static_cast<float>(Atan2Double(std::sqrt((1 - c) * (1 + c)), c));
}

}  // namespace lumifold
