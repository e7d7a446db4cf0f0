#pragma once

#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/halves.h"
#include "filter/layers/nlm_space.h"

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

/// Feature vectors of both halves.
struct FeaturePair {
  Planes a;
  Planes b;
};

/// [NLM coordinates of each half / sigma_q | geometry] in one basis for both. Consumes the guide: its planes
/// are freed before the manifolds need memory.
/// Threads: identical for any pool.
FeaturePair MakeFeatures(Guide&& from, const Halves& halves, const PatchParams& patches, float sigma_q,
                         const Planes& geometry, TaskPool* pool);

}  // namespace lumifold::filter
