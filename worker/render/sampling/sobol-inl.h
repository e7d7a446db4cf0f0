// Owen-scrambled Sobol pairs of one sample or of several side by side: included where Bits, its operators
// and ReverseBits() are those of one number (sampler.cc) or of a vector (sobol_lanes.cc).

/// Owen's nested uniform scramble of a value with reversed bits (lowest first): a hash of the bits below bit
/// k decides whether bit k is flipped.
HWY_INLINE Bits ScrambleReversed(Bits x, Bits seed) {
  x = x ^ (x * Bits(0x3d20adeau));
  x = x + seed;
  x = x * ((seed >> 16) | Bits(1u));
  x = x ^ (x * Bits(0x05526c56u));
  return x ^ (x * Bits(0x53a22864u));
}

/// The second Sobol dimension of index i, bits reversed: the product with Pascal's triangle modulo 2,
/// computed by recursive halving.
HWY_INLINE Bits SobolSecondReversed(Bits i) {
  i = i ^ ((i >> 1) & Bits(0x55555555u));
  i = i ^ ((i >> 2) & Bits(0x33333333u));
  i = i ^ ((i >> 4) & Bits(0x0f0f0f0fu));
  i = i ^ ((i >> 8) & Bits(0x00ff00ffu));
  return i ^ ((i >> 16) & Bits(0x0000ffffu));
}

/// The pair of a sample from its index in its half, bits reversed, and Sampler::Seeds; as fractions of 2^32.
HWY_INLINE void DrawPair(Bits reversed_index, Bits shuffle, Bits scramble, Bits* x, Bits* y) {
  const Bits index = ReverseBits(ScrambleReversed(reversed_index, shuffle));
  const Bits scramble_y = scramble * Bits(0x9e3779b1u) + shuffle;
  // Sobol's first dimension is the bit-reversed index; reversed again it is the index itself.
  *x = ReverseBits(ScrambleReversed(index, scramble));
  *y = ReverseBits(ScrambleReversed(SobolSecondReversed(index), scramble_y));
}
