// Directions from numbers, of one sample or of several side by side: included where Num, Num2, Num3, Mask
// and their functions are those of a float (frame.h) or of a vector (lanes/base_lobes-inl.h). Both have the
// same bits.

/// A right-handed orthonormal basis whose z axis is a given unit vector.
/// Source: Duff et al. 2017, "Building an Orthonormal Basis, Revisited".
struct Frame {
  Num3 x, y, z;

  HWY_INLINE static Frame Of(Num3 z) {
    const Num sign = CopySign(Num(1.0f), z.z);
    const Num a = Num(-1.0f) / (sign + z.z);
    const Num b = z.x * z.y * a;
    return {{Num(1.0f) + sign * z.x * z.x * a, sign * b, -sign * z.x}, {b, sign + z.y * z.y * a, -z.y}, z};
  }
  HWY_INLINE Num3 ToLocal(Num3 v) const { return {Dot(v, x), Dot(v, y), Dot(v, z)}; }
  HWY_INLINE Num3 ToWorld(Num3 v) const { return x * v.x + y * v.y + z * v.z; }
};

/// Maps the unit square to the unit disk; preserves relative areas and adjacency. Source: Shirley & Chiu
/// 1997.
HWY_INLINE Num2 ConcentricDisk(Num2 u) {
  const Num one = 1.0f;
  const Num a = Num(2.0f) * u.x - one;
  const Num b = Num(2.0f) * u.y - one;
  const Mask along_x = Abs(a) > Abs(b);
  const Num radius = Select(along_x, a, b);
  // The angle from the nearer axis is at most pi / 4, where short series reach float precision.
  const Num angle = Num(0.785398163f) * (Select(along_x, b, a) / radius);
  const Num x2 = angle * angle;
  const Num sine =
      angle * (one - x2 * Num(1.0f / 6) * (one - x2 * Num(1.0f / 20) * (one - x2 * Num(1.0f / 42))));
  const Num cosine =
      one - x2 * Num(0.5f) *
                (one - x2 * Num(1.0f / 12) * (one - x2 * Num(1.0f / 30) * (one - x2 * Num(1.0f / 56))));
  const Mask is_centre = Not(Or(a != Num(0.0f), b != Num(0.0f)));
  const Num near = Select(is_centre, Num(0.0f), radius * cosine);
  const Num far = Select(is_centre, Num(0.0f), radius * sine);
  return {Select(along_x, near, far), Select(along_x, far, near)};
}

/// A direction above the surface, in proportion to its cosine, from a uniform point of the unit disk.
HWY_INLINE Num3 CosineDirection(Num2 disk) {
  return {disk.x, disk.y, Sqrt(Max(Num(0.0f), Num(1.0f) - disk.x * disk.x - disk.y * disk.y))};
}
