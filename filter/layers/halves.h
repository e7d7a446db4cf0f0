#pragma once

#include "filter/image/parallel.h"
#include "filter/image/plane.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

/// One layer as its two independent halves A and B, safe to compute with: finite, and scaled so that the
/// layer's mean is about 1.
struct Halves {
  Planes a;  // 3 planes; where half A knows nothing, what B knows
  Planes b;
  Plane weight_a;  // the part of the pixel that is valid where half A has a usable value, else 0
  Plane weight_b;
  Plane weight;     // the same where either has
  Plane share_a;    // nA / n: X = share_a * A + (1 - share_a) * B
  float scale = 1;  // stored value * scale = the layer's unit; a power of two, so that scaling loses nothing
  float level = 0;  // mean magnitude of the halves as they are here, about 1; 0 for a black layer
  bool has_noise_estimate = false;  // whether any pixel has both halves
  bool is_difference = false;       // of light and not light itself: of either sign, and mostly near 0
  /// Light of the picture it is part of, over the picture's mean, by which its errors are weighed
  /// (ErrorWeight); empty: the layer's own.
  Plane picture_light;

  int width() const { return weight.width(); }
  int height() const { return weight.height(); }
};

/// A layer's halves as a film has them. All views of one size.
struct HalvesView {
  ConstColorView a;
  ConstColorView b;
  ConstFloatView samples_a;
  ConstFloatView samples_b;
};

/// NaN, infinite and absurd values (over 1e30) count as unknown. `validity`: the part of each
/// pixel the layer's surface covers, 0 to 1. Values are means over the whole pixel; the halves hold what the
/// covered part alone would show.
Halves MakeHalves(const HalvesView& film, ConstFloatView validity, TaskPool* pool);

/// X = share_a * A + (1 - share_a) * B, plane by plane.
Planes Combine(const Planes& a, const Planes& b, ConstFloatView share_a, TaskPool* pool);

/// Variance of X, per pixel and channel: nA nB (A - B)^2 / n^2. A single pixel's is very rough: average
/// before use.
Planes PixelVariance(const Planes& a, const Planes& b, ConstFloatView share_a, TaskPool* pool);

/// RMS noise of X over all channels and the pixels where both halves are known; where none is, a guess from
/// the picture's own second differences along rows, which edges and texture make too large.
float NoiseLevel(const Halves& halves, const Planes& a, const Planes& b, TaskPool* pool);

}  // namespace lumifold::filter
