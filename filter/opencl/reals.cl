// Numbers of double precision with the processor's bits, also on devices that have none: there the operations of IEEE 754 are done
// with integers (DOUBLES 0).
#if DOUBLES

typedef double Real;

Real RealOf(float x) { return (double)x; }
Real RealOfBits(ulong bits) { return as_double(bits); }
float FloatOf(Real x) { return (float)x; }
Real Sum(Real a, Real b) { return a + b; }
Real Product(Real a, Real b) { return a * b; }
Real Quotient(Real a, Real b) { return a / b; }
Real Root(Real x) { return sqrt(x); }
int IsGreater(Real a, Real b) { return a > b; }

#else

// Sign, exponent, fraction. Finite numbers alone; what is too large becomes infinite.
typedef ulong Real;

// A number without its sign: significand * 2^(exponent - 1023 - 62), of which the top bit is bit 62. Zero has none.
typedef struct {
  int exponent;
  ulong significand;
} Magnitude;

ulong SignOf(Real x) { return x & 0x8000000000000000UL; }

Magnitude MagnitudeOf(Real x) {
  Magnitude a;
  a.exponent = (int)(x >> 52 & 0x7ff);
  a.significand = x & 0xfffffffffffffUL;
  if (a.exponent > 0)
    a.significand |= 0x10000000000000UL;
  else
    a.exponent = 1;
  const int shift = a.significand == 0 ? 10 : (int)clz(a.significand) - 1;
  a.significand <<= shift;
  a.exponent -= shift - 10;
  return a;
}

// Shifted to the right; the last bit says whether any bit that is lost was set.
ulong Jam(ulong x, int shift) {
  if (shift <= 0) return x;
  if (shift > 63) return x != 0;
  return x >> shift | (x << (64 - shift) != 0);
}

// Rounded to nearest, ties to even. The last bit of the significand stands for all behind it.
Real Rounded(ulong sign, Magnitude a) {
  if (a.significand == 0) return sign;
  if (a.exponent < 1) {
    a.significand = Jam(a.significand, 1 - a.exponent);
    a.exponent = 1;
  }
  const ulong rest = a.significand & 0x3ff;
  ulong fraction = (a.significand + 0x200) >> 10;
  if (rest == 0x200) fraction &= ~1UL;
  const ulong bits = ((ulong)(a.exponent - 1) << 52) + fraction;
  return sign | (bits < 0x7ff0000000000000UL ? bits : 0x7ff0000000000000UL);
}

Real RealOfBits(ulong bits) { return bits; }

Real RealOf(float x) {
  const uint bits = (uint)as_int(x);
  const ulong sign = (ulong)(bits >> 31) << 63;
  Magnitude a;
  a.exponent = (int)(bits >> 23 & 0xff);
  a.significand = bits & 0x7fffff;
  if (a.exponent > 0)
    a.significand |= 0x800000;
  else
    a.exponent = 1;
  if (a.significand == 0) return sign;
  const int shift = (int)clz(a.significand) - 1;
  a.significand <<= shift;
  a.exponent += 1023 - 127 + 39 - shift;
  return Rounded(sign, a);
}

float FloatOf(Real x) {
  Magnitude a = MagnitudeOf(x);
  const uint sign = (uint)(SignOf(x) >> 32);
  int exponent = a.exponent - (1023 - 127);
  uint significand = (uint)Jam(a.significand, 32);  // the top bit is bit 30
  if (exponent < 1) {
    significand = (uint)Jam(significand, 1 - exponent);
    exponent = 1;
  }
  uint fraction = (significand + 0x40) >> 7;
  if ((significand & 0x7f) == 0x40) fraction &= ~1U;
  const ulong bits = ((ulong)(exponent - 1) << 23) + fraction;
  return as_float((int)(sign | (bits < 0x7f800000UL ? (uint)bits : 0x7f800000U)));
}

int IsBelow(Magnitude a, Magnitude b) {
  if (a.significand == 0 || b.significand == 0) return a.significand == 0 && b.significand != 0;
  return a.exponent < b.exponent || (a.exponent == b.exponent && a.significand < b.significand);
}

Real Sum(Real x, Real y) {
  Magnitude a = MagnitudeOf(x), b = MagnitudeOf(y);
  if (a.significand == 0) return b.significand == 0 ? x & y : y;
  if (b.significand == 0) return x;
  ulong sign = SignOf(x);
  if (IsBelow(a, b)) {
    const Magnitude larger = b;
    b = a;
    a = larger;
    sign = SignOf(y);
  }
  const ulong smaller = Jam(b.significand, a.exponent - b.exponent);
  if (SignOf(x) == SignOf(y)) {
    a.significand = Jam(a.significand + smaller, 1);
    a.exponent += 1;
    if (a.significand >> 62 == 0) {
      a.significand = a.significand << 1;
      a.exponent -= 1;
    }
    return Rounded(sign, a);
  }
  a.significand -= smaller;
  if (a.significand == 0) return 0;
  const int shift = (int)clz(a.significand) - 1;
  a.significand <<= shift;
  a.exponent -= shift;
  return Rounded(sign, a);
}

Real Product(Real x, Real y) {
  Magnitude a = MagnitudeOf(x);
  const Magnitude b = MagnitudeOf(y);
  const ulong sign = SignOf(x) ^ SignOf(y);
  if (a.significand == 0 || b.significand == 0) return sign;
  const ulong factor = b.significand << 1;
  const ulong high = mul_hi(a.significand, factor);
  a.exponent += b.exponent - 1023 + 1;
  a.significand = high | (a.significand * factor != 0);
  if (a.significand >> 62 == 0) {
    a.significand <<= 1;
    a.exponent -= 1;
  }
  return Rounded(sign, a);
}

// y is not 0.
Real Quotient(Real x, Real y) {
  Magnitude a = MagnitudeOf(x);
  const Magnitude b = MagnitudeOf(y);
  const ulong sign = SignOf(x) ^ SignOf(y);
  if (a.significand == 0) return sign;
  a.exponent += 1023 - b.exponent;
  if (a.significand < b.significand) {
    a.significand <<= 1;
    a.exponent -= 1;
  }
  ulong rest = a.significand, quotient = 0;
  for (int bit = 0; bit < 63; ++bit) {
    const int is_set = rest >= b.significand;
    quotient = quotient << 1 | (ulong)is_set;
    rest = (rest - (is_set ? b.significand : 0)) << 1;
  }
  a.significand = quotient | (rest != 0);
  return Rounded(sign, a);
}

// x >= 0.
Real Root(Real x) {
  Magnitude a = MagnitudeOf(x);
  if (a.significand == 0) return x;
  ulong digits = a.significand;  // with two digits before the point
  const int is_odd = (a.exponent - 1023) & 1;
  if (is_odd) digits <<= 1;
  a.exponent = (a.exponent - 1023 - is_odd) / 2 + 1023;
  ulong root = 0, rest = 0;
  for (int bit = 0; bit < 55; ++bit) {
    rest = rest << 2 | digits >> 62;
    digits <<= 2;
    const ulong trial = root << 2 | 1;
    const int is_set = rest >= trial;
    root = root << 1 | (ulong)is_set;
    rest -= is_set ? trial : 0;
  }
  a.significand = root << 8 | (rest != 0);
  return Rounded(0, a);
}

int IsGreater(Real x, Real y) {
  const Magnitude a = MagnitudeOf(x), b = MagnitudeOf(y);
  if (a.significand == 0 && b.significand == 0) return 0;
  if (SignOf(x) != SignOf(y)) return SignOf(y) != 0;
  return SignOf(x) != 0 ? IsBelow(a, b) : IsBelow(b, a);
}

#endif

// Quotient, root, product and sum of each pair of numbers.
__kernel void ProbeReals(int count, __global const float* a, __global const float* b, __global Real* results) {
  const size_t item = get_global_id(0);
  if (item >= (size_t)count) return;
  const Real u = RealOf(a[item]), v = RealOf(b[item]);
  results[3 * item] = Quotient(u, v);
  results[3 * item + 1] = Root(u);
  results[3 * item + 2] = Sum(Product(u, Quotient(v, RealOf(3.0f))), u);
}
