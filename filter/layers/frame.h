#pragma once

#include <algorithm>
#include <array>
#include <optional>
#include <string_view>
#include <vector>

#include "filter/image/edged_image.h"
#include "filter/image/layered_image.h"
#include "filter/image/layers.h"
#include "filter/image/planes.h"
#include "filter/layers/edge_views.h"

namespace lumifold::filter {

/// A layer of light: the mean over all samples, and the means of its two independent halves.
struct HalvedLayer {
  ConstColorView mean, a, b;

  bool IsEmpty() const { return mean[0].IsEmpty() || a[0].IsEmpty() || b[0].IsEmpty(); }
};

/// Sample counts of the two halves.
struct SampleCounts {
  ConstFloatView a, b;

  bool IsEmpty() const { return a.IsEmpty() || b.IsEmpty(); }
  float At(int x, int y) const { return a.At(x, y) + b.At(x, y); }
  bool HasBoth(int x, int y) const { return a.At(x, y) > 0 && b.At(x, y) > 0; }
  /// nA / n; 0 without samples.
  float ShareA(int x, int y) const { return a.At(x, y) > 0 ? a.At(x, y) / At(x, y) : 0.0f; }
  /// weight * nA nB / n^2: times (A - B)^2 it is the variance of the mean.
  float VarianceFactor(int x, int y, float weight = 1) const {
    const float n = std::max(1.0f, At(x, y));
    return weight * a.At(x, y) * b.At(x, y) / (n * n);
  }
};

/// A layer of each half: its mean over both where the film has no halves of it, which is so without a lens.
using ColorOfHalves = std::array<ConstColorView, 2>;

/// What is known of the surface that a pixel shows.
struct SurfaceViews {
  ConstColorView albedo;    // T, the throughput of the chain in it
  ColorOfHalves albedo_of;  // of each half
  ColorOfHalves emission_of;
  ConstColorView normal;    // turned back by mirrors on the way
  ConstFloatView distance;  // along the whole way; 0 where nothing is hit
  ConstFloatView mask;      // part of the pixel that shows a surface with a diffuse lobe
  ConstFloatView blur;      // layers::kBlur; empty: no lens
  /// Made of two pictures of another renderer (JoinHalves()): T, S and E of each half, the normal and the
  /// distance are means over its samples alone.
  bool is_foreign = false;
};

/// Of the first hit's glossy lobes.
struct GlossViews {
  ConstFloatView roughness;
  ConstColorView albedo;  // S
};

/// Light of the first surface's lobes other than the diffuse one, and the layer that multiplies it.
struct LobeViews {
  std::string_view name;  // of the light: layers::kGlossy or layers::kTransmitted
  HalvedLayer light;
  ConstColorView factor;
  ColorOfHalves factor_of;  // of each half
};

/// The surface seen after a chain of delta events.
struct LevelViews {
  layers::Level level;
  HalvedLayer direct, indirect;
  ConstColorView emission;
  SurfaceViews surface;
  SampleCounts samples;
};

/// The film's fragments (EdgedImage::fragments): one row each.
struct FragmentViews {
  ConstFloatView x, y, key, distance, roughness;
  ConstColorView normal, albedo, emission, glossy_albedo;
  std::array<ConstColorView, 2> direct, indirect, glossy;  // of half A and B
  SampleCounts samples;

  int rows() const { return x.height(); }
};

/// What is added to C, half A and half B: 3 planes each, W x H. A pixel of zeros keeps C to the last bit.
using FrameChange = std::array<Planes, 2>;

/// Typed views of a film, its edge set and its fragments, resolved once; all must outlive it. Views of
/// channels that the film lacks are empty. All others are W x H.
struct Frame {
  int width = 0;
  int height = 0;
  HalvedLayer combined;          // C
  HalvedLayer direct, indirect;  // D, I
  ConstColorView emission;       // E
  SurfaceViews surface;          // of the first hit, with T
  ConstFloatView object_id;
  GlossViews gloss;
  std::vector<LobeViews> lobes;    // G and transmitted light, where the film has both light and factor
  std::vector<LevelViews> levels;  // all that the film has any channel of, in the order of their index
  SampleCounts samples;            // of the first hit
  Plane level_mask;                // 1 where a pixel shows a level, else 0
  std::optional<EdgeViews> edges;
  std::optional<FragmentViews> fragments;

  /// `edges` and `fragments` may be null or without channels.
  explicit Frame(const LayeredImage& film, const LayeredImage* edges = nullptr,
                 const LayeredImage* fragments = nullptr);
  explicit Frame(const EdgedImage& film) : Frame(film.pixels, &film.edges, &film.fragments) {}

  Rect bounds() const { return {0, 0, width, height}; }
};

/// Whether a lens blurs the pixel, so that T, E, S and the coverage vary in it more than in a sharp one.
inline bool IsBlurred(const Frame& frame, int x, int y) {
  constexpr float kLeastBlur = 0.5f;  // pixels
  return !frame.surface.blur.IsEmpty() && frame.surface.blur.At(x, y) >= kLeastBlur;
}

/// Whether T, S, E and the coverage of the pixel have noise that its halves show: a lens blurs it, or another
/// renderer has them from its samples alone.
inline bool HasNoisyFactors(const Frame& frame, int x, int y) {
  return frame.surface.is_foreign || IsBlurred(frame, x, y);
}

}  // namespace lumifold::filter
