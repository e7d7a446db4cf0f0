// The double precision that reals.cl does with integers, against the processor's.

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <random>

namespace lumifold::filter {
namespace {

namespace kernels {

using ulong = uint64_t;
using uint = uint32_t;
size_t get_global_id(int) { return 0; }
int as_int(float x) { return std::bit_cast<int>(x); }
float as_float(int x) { return std::bit_cast<float>(x); }
ulong clz(ulong x) { return static_cast<ulong>(std::countl_zero(x)); }
ulong mul_hi(ulong a, ulong b) {
  const ulong a_high = a >> 32, a_low = a & 0xffffffff, b_high = b >> 32, b_low = b & 0xffffffff;
  const ulong middle = a_high * b_low + (a_low * b_low >> 32);
  return a_high * b_high + (middle >> 32) + ((a_low * b_high + (middle & 0xffffffff)) >> 32);
}
// NOLINTBEGIN(bugprone-reserved-identifier,clang-diagnostic-reserved-macro-identifier): words of OpenCL
#define __kernel [[maybe_unused]]
#define __global
// NOLINTEND(bugprone-reserved-identifier,clang-diagnostic-reserved-macro-identifier)
#define DOUBLES 0
#include "filter/opencl/reals.cl"

}  // namespace kernels

uint64_t BitsOf(double x) { return std::bit_cast<uint64_t>(x); }
uint32_t BitsOf(float x) { return std::bit_cast<uint32_t>(x); }

/// Numbers of any size, denormal ones, zeros, and many that nearly cancel or lie between two neighbours.
class Numbers {
 public:
  double Next() {
    uint64_t bits = random_();
    uint64_t exponent = random_() % 2046;
    switch (random_() % 5) {
      case 0:
        exponent = 1003 + random_() % 40;
        break;
      case 1:
        exponent = random_() % 60;
        break;
      case 2:
        exponent = 1022 + random_() % 3;
        bits &= ~(0xffffffffffULL << (random_() % 13));
        break;
      case 3:
        bits &= ~0xfffffffffffffULL;
        exponent *= random_() % 2;
        break;
      default:
        break;
    }
    return std::bit_cast<double>((bits & 0x800fffffffffffffULL) | exponent << 52);
  }
  float NextFloat() {
    const auto bits = static_cast<uint32_t>(random_());
    return std::bit_cast<float>((bits >> 23 & 0xff) == 0xff ? bits ^ 0x40000000 : bits);
  }

 private:
  std::mt19937_64 random_{1};
};

TEST(Reals, AreThoseOfTheProcessor) {
  Numbers numbers;
  for (int i = 0; i < 300'000; ++i) {
    const double a = numbers.Next(), b = numbers.Next(), size = std::abs(a);
    SCOPED_TRACE(testing::Message() << std::hexfloat << a << ' ' << b);
    const kernels::Real x = kernels::RealOfBits(BitsOf(a)), y = kernels::RealOfBits(BitsOf(b));
    ASSERT_EQ(kernels::Sum(x, y), BitsOf(a + b));
    ASSERT_EQ(kernels::Product(x, y), BitsOf(a * b));
    if (b != 0) {
      ASSERT_EQ(kernels::Quotient(x, y), BitsOf(a / b));
    }
    ASSERT_EQ(kernels::Root(BitsOf(size)), BitsOf(std::sqrt(size)));
    ASSERT_EQ(kernels::IsGreater(x, y) != 0, a > b);
    ASSERT_EQ(BitsOf(kernels::FloatOf(x)), BitsOf(static_cast<float>(a)));
    const float single = numbers.NextFloat();
    ASSERT_EQ(kernels::RealOf(single), BitsOf(static_cast<double>(single)));
  }
}

}  // namespace
}  // namespace lumifold::filter
