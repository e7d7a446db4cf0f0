// What an emitter, or a group of them, may bring to shading points: included where Num, Num3 and their
// functions are those of a float (light_tree.cc) or of a vector of shading points (lanes/pick_lanes.cc). Both
// have the same bits. Source: Conty Estevez & Kulla 2018 (importance).

/// Cosine and sine of max(0, a - b), from the sines and cosines of a and b.
HWY_INLINE Num CosineOfDifference(Num sin_a, Num cos_a, Num sin_b, Num cos_b) {
  return Select(cos_a > cos_b, 1.0f, cos_a * cos_b + sin_a * sin_b);
}
HWY_INLINE Num SineOfDifference(Num sin_a, Num cos_a, Num sin_b, Num cos_b) {
  return Select(cos_a > cos_b, 0.0f, sin_a * cos_b - cos_a * sin_b);
}

HWY_INLINE Num SineOf(Num cosine) { return Sqrt(Max(0.0f, Num(1.0f) - cosine * cosine)); }

/// `behind` is -1 where light from behind counts too, else 1. Without branches, so that compilers make
/// vectors of it in LightLeaf::Weigh().
HWY_INLINE Num Importance(const LightExtent& extent, Num3 position, Num3 normal, Num behind) {
  const Num zero = 0.0f;
  const Num one = 1.0f;
  const Num radius = extent.radius;
  const Num3 offset = position - Num3{extent.center.x, extent.center.y, extent.center.z};
  const Num distance2 = Dot(offset, offset);
  const Num radius2 = radius * radius;
  // Near or inside the box the distance to its centre is meaningless.
  const Num reach2 = Max(distance2, radius2);
  const Num inverse = one / Sqrt(Max(distance2, std::numeric_limits<float>::min()));
  // The cone of directions in which the box lies.
  const Mask inside = distance2 <= radius2;
  const Num sin_box = Select(inside, zero, radius * inverse);
  const Num cos_box = Select(inside, -1.0f, SineOf(sin_box));

  const Num cos_front = Dot(Num3{extent.axis.x, extent.axis.y, extent.axis.z}, offset) * inverse;
  const Num cos_axis = Max(cos_front, Num(1.0f - 2.0f * extent.both_sides) * cos_front);
  const Num sin_axis = SineOf(cos_axis);
  const Num cos_cone = CosineOfDifference(sin_axis, cos_axis, extent.sin_spread, extent.cos_spread);
  const Num sin_cone = SineOfDifference(sin_axis, cos_axis, extent.sin_spread, extent.cos_spread);
  const Num cos_emitted = CosineOfDifference(sin_cone, cos_cone, sin_box, cos_box);

  const Num cos_above = -Dot(normal, offset) * inverse;
  const Num cos_normal = Max(cos_above, behind * cos_above);
  const Num cos_received = CosineOfDifference(SineOf(cos_normal), cos_normal, sin_box, cos_box);
  const Num importance = Max(zero, Num(extent.intensity) * cos_emitted * cos_received / reach2);
  const Num emitted = Select(cos_emitted <= Num(extent.cos_falloff), zero, importance);
  return Select(reach2 > zero, emitted, extent.intensity);
}
