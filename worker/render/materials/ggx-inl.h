// The GGX microfacet distribution with Smith's height-correlated masking, and Fresnel's reflectance, of one
// sample or of several side by side: included where Num, Num2, Num3, Mask and their functions are those of
// a float (microfacet.h) or of a vector (lanes/base_lobes-inl.h). Both have the same bits. Alpha is a Num
// where all microfacets are isotropic, or a GgxAlpha. Directions are unit, in the shading frame (z =
// normal). Sources: Walter et al. 2007; Heitz 2014 (masking, anisotropy); Heitz 2018 (sampling of visible
// normals).

HWY_INLINE Num Product(Num alpha) { return alpha * alpha; }
HWY_INLINE Num SquaredTowards(Num alpha, Num3) { return alpha * alpha; }
HWY_INLINE Num3 Stretched(Num3 v, Num alpha) { return {alpha * v.x, alpha * v.y, v.z}; }
/// The squares of the normal's horizontal coordinates, of the ellipse that is as large as a circle of
/// radius 1.
HWY_INLINE Num2 EllipseSquares(Num3 h, Num) { return {h.x * h.x, h.y * h.y}; }

/// Density of microfacet normals at h, per projected steradian.
template <typename Alpha>
HWY_INLINE Num GgxDensity(Num3 h, Alpha alpha) {
  const Num a2 = Product(alpha);
  const Num2 squares = EllipseSquares(h, alpha);
  // The textbook form cos^2 (a2 - 1) + 1 suffers from cancellation at small alpha; this form does not.
  const Num t = a2 * h.z * h.z + squares.x + squares.y;
  return a2 / (Num(kPi) * t * t);
}

/// Height-correlated masking and shadowing over 4 cos_i cos_o: the "visibility" term V = G / (4 |wi.z|
/// |wo.z|). Both directions are on the upper side.
template <typename Alpha>
HWY_INLINE Num GgxVisibility(Num3 wi, Num3 wo, Alpha alpha) {
  const Num a2_o = SquaredTowards(alpha, wo);
  const Num a2_i = SquaredTowards(alpha, wi);
  const Num lambda_o = wi.z * Sqrt(wo.z * wo.z * (Num(1.0f) - a2_o) + a2_o);
  const Num lambda_i = wo.z * Sqrt(wi.z * wi.z * (Num(1.0f) - a2_i) + a2_i);
  return Num(0.5f) / (lambda_o + lambda_i);
}

/// Samples a microfacet normal visible from wo, with density GgxVisibleDensity(), from a uniform point of the
/// unit disk.
template <typename Alpha>
HWY_INLINE Num3 SampleGgxVisibleNormal(Num3 wo, Alpha alpha, Num2 disk) {
  const Num zero = 0.0f;
  const Num one = 1.0f;
  const Num3 stretched = Normalize(Stretched(wo, alpha));
  const Num length2 = stretched.x * stretched.x + stretched.y * stretched.y;
  const Num3 across = Num3{-stretched.y, stretched.x, zero} / Sqrt(length2);
  const Num3 t1 = Select(length2 > zero, across, Num3{one, zero, zero});
  const Num3 t2 = Cross(stretched, t1);
  const Num p1 = disk.x;
  const Num s = Num(0.5f) * (one + stretched.z);
  const Num p2 = (one - s) * Sqrt(Max(zero, one - p1 * p1)) + s * disk.y;
  const Num3 n = t1 * p1 + t2 * p2 + stretched * Sqrt(Max(zero, one - p1 * p1 - p2 * p2));
  return Normalize(Stretched(Num3{n.x, n.y, Max(Num(1e-6f), n.z)}, alpha));
}

/// Density of SampleGgxVisibleNormal, per steradian of h.
template <typename Alpha>
HWY_INLINE Num GgxVisibleDensity(Num3 wo, Num3 h, Alpha alpha) {
  const Num a2 = SquaredTowards(alpha, wo);
  // G1(wo) / wo.z, in a form that is finite at grazing angles
  const Num masking = Num(2.0f) / (wo.z + Sqrt(a2 + (Num(1.0f) - a2) * wo.z * wo.z));
  return masking * Max(Num(0.0f), Dot(wo, h)) * GgxDensity(h, alpha);
}

/// The reflection of wo by a microfacet with normal h.
HWY_INLINE Num3 MirrorDirection(Num3 wo, Num3 h) { return h * (Num(2.0f) * Dot(wo, h)) - wo; }

/// Schlick's approximation of the Fresnel reflectance; f0 and f90 are its values at normal and grazing
/// incidence.
HWY_INLINE Num3 SchlickFresnel(Num3 f0, Num3 f90, Num cos_theta) {
  const Num m = Where(cos_theta < Num(1.0f), Num(1.0f) - cos_theta);
  const Num m2 = m * m;
  return f0 + (f90 - f0) * (m2 * m2 * m);
}

/// What raises the reflection of microfacets of metal of colour `b` by the energy that they lose between
/// each other: 1 + F0 (1 - E) / E of metal's part of the albedo `single`, with E = scale + bias the albedo
/// at F0 = 1.
HWY_INLINE Num3 MetalGain(Num3 b, Num metallic, Num scale, Num bias, Num3 single) {
  const Num one = 1.0f;
  const Num least = 1e-20f;  // black metal, seen along its normal, has albedo 0
  const Num whole = scale + bias;
  const Num3 compensation = b * (b * scale + Num3{bias, bias, bias}) * (metallic * (one - whole) / whole);
  return {one + compensation.x / Max(single.x, least), one + compensation.y / Max(single.y, least),
          one + compensation.z / Max(single.z, least)};
}
