#pragma once

#include <vector>

#include "absl/types/span.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/halves.h"
#include "filter/manifold/filter_device.h"
#include "filter/manifold/manifold_filter.h"
#include "filter/manifold/nlm_space.h"

namespace lumifold::filter {

/// Both halves of a picture as guides: with stabilised variance (Stabilise).
struct Guide {
  Planes a;
  Planes b;
};

/// `knee`: over the layer's mean.
Guide MakeGuide(const Halves& halves, const Planes& a, const Planes& b, float knee, TaskPool* pool);

/// RMS noise of one half of the guide; noise-free layers count as having a little, so that no range is 0.
float NoiseOfHalf(const Halves& halves, const Guide& guide, TaskPool* pool);

/// Features of a picture, [NLM coordinates | geometry], of which the coordinates are projected where a filter
/// needs them.
struct JointGuide {
  Planes color;
  PatchBasis basis;  // its kernels over sigma_q
  absl::Span<const Plane> geometry;
};
JointGuide MakeJointGuide(Planes color, const PatchBasis& basis, float sigma_q,
                          absl::Span<const Plane> geometry);

/// The features, projected.
Planes JointFeatures(const JointGuide& guide, TaskPool* pool);

/// Of both halves.
struct JointGuides {
  JointGuide a;
  JointGuide b;
};

/// In one basis for both.
/// Threads: identical for any pool.
JointGuides MakeJointGuides(Guide guide, const Halves& halves, const PatchParams& patches, float sigma_q,
                            absl::Span<const Plane> geometry, TaskPool* pool);

/// A filtering of a picture by the features of a guide.
struct GuidedFiltering {
  const Planes& signals;
  const Planes* base;  // that is subtracted from them, but not from those of points; null: nothing is
  const JointGuide& guide;
  float scale;  // that the coordinates of patches are multiplied by
  ConstFloatView mask;
  const SlicePoints* points;  // may be null
};

/// ManifoldFilterAtPoints for each; on the device of the pool, if it has one. Those of one guide come one
/// after another, those of scale 1 first.
/// Threads: identical for any pool.
std::vector<ManifoldResult> FilterGuided(absl::Span<const GuidedFiltering> filterings,
                                         const ManifoldParams& params, float reach, TaskPool* pool);

}  // namespace lumifold::filter
