#pragma once

#include "filter/image/parallel.h"
#include "filter/image/plane.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

/// A layer as its two independent halves A and B, safe to compute with: finite, and scaled so that the
/// layer's mean is about 1.
struct Halves {
  Planes a;  // 3 planes; where half A has no usable value, that of B, and the reverse
  Planes b;
  Plane weight_a;  // the part of the pixel that is valid where half A has a usable value, else 0
  Plane weight_b;
  Plane weight;     // the same where either has
  Plane share_a;    // nA / n: X = share_a * A + (1 - share_a) * B
  Plane samples;    // n = nA + nB
  float scale = 1;  // stored value * scale = the layer's unit; a power of two, so that scaling loses nothing
  float level = 0;  // mean magnitude of the halves as they are here, about 1; 0 for a black layer
  bool has_noise_estimate = false;  // whether most pixels that have a half have both
  bool is_difference = false;       // a difference of light: of either sign, and mostly near 0
  /// Light of the whole picture over its mean, which weights the layer's errors (ErrorWeight); empty: the
  /// layer's own light.
  Plane picture_light;
  /// Squared difference of the halves to be expected from what is known of their samples, sum of the
  /// channels: halves may agree by chance. Empty: nothing is known.
  Plane expected_difference;
  /// 1 where several surfaces meet in a pixel or next to it, else 0: errors are averaged over pixels of one
  /// kind.
  Plane is_mixed;

  int width() const { return weight.width(); }
  int height() const { return weight.height(); }
};

/// Half A for 0, B for 1.
inline const Planes& HalfOf(const Halves& halves, size_t h) { return h == 0 ? halves.a : halves.b; }

/// A layer's halves as in a film. All views have one size.
struct HalvesView {
  ConstColorView a;
  ConstColorView b;
  ConstFloatView samples_a;
  ConstFloatView samples_b;
};

/// Scales a film's halves and marks what is usable (IsUsable). `validity`: the part of each pixel that the
/// layer's surface covers, 0 to 1. The film's values are means over the whole pixel; the halves hold means
/// over the covered part.
/// Threads: identical for any pool.
Halves MakeHalves(const HalvesView& film, ConstFloatView validity, TaskPool* pool);

/// weight_a * weight_b: over 0 where both halves are known, since errors can be measured only there.
Plane BothHalvesMask(const Halves& halves);

/// X = share_a * A + (1 - share_a) * B, plane by plane.
Planes Combine(const Planes& a, const Planes& b, ConstFloatView share_a, TaskPool* pool);

/// x - y, plane by plane.
Planes Difference(const Planes& x, const Planes& y, TaskPool* pool);

/// RMS noise of X over all channels and the pixels where both halves are known. Where none is, an estimate
/// from second differences along rows, which edges and texture make too large.
float NoiseLevel(const Halves& halves, const Planes& a, const Planes& b, TaskPool* pool);

/// NoiseLevel of the halves themselves, at least 1e-4 of their level: what a range can be measured in.
float PositiveNoise(const Halves& halves, TaskPool* pool);

}  // namespace lumifold::filter
