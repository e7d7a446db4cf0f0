#pragma once

#include "filter/edges/antialiasing.h"
#include "filter/image/parallel.h"
#include "filter/layers/halves.h"
#include "filter/layers/nlm_space.h"
#include "filter/layers/selection.h"
#include "filter/manifold/manifold_filter.h"

namespace lumifold::filter {

/// One wide filtering, without a choice. The defaults are the paper's own.
struct OnePassParams {
  float range_factor = 1.8f;  // sigma_q over the layer's noise
  ManifoldParams manifolds;
};

/// How one layer is filtered. The defaults are the "default" method.
struct LayerParams {
  PatchParams patches;                          // of the noisy layer
  PatchParams pilot_patches = {1, 3, 6, 0.95};  // of its first filtering
  float range_factor = 1.8f;        // sigma_q of the first filtering over the noise of the half that guides
  float pilot_range_factor = 0.3f;  // sigma_q of the second, over the same
  float knee = 0.2f;                // of the stabilised guide, over the layer's mean
  // Manifolds of both are near each other, for they have to follow fine detail.
  ManifoldParams pilot_manifolds = {
      .sigma_s = 7, .height = 5, .cell = 4, .is_first_order = true};  // of the first filtering
  float pilot_reach = 12;                                             // px
  ManifoldParams manifolds = {.sigma_s = 2, .height = 4};             // of the second
  float reach = 6;                                                    // px
  SelectionParams selection;
  /// Where one half alone is known: its noise is then a rough guess, and geometry guides far better than
  /// patches.
  OnePassParams without_halves = {.range_factor = 8, .manifolds = {.sigma_s = 8, .height = 5}};
  // Steps that measurements leave out, to see what each is worth.
  bool suppresses_fireflies = true;
  bool has_second_pass = true;
  bool chooses = true;  // else the last filtering everywhere
};

/// A filtered layer, in its halves' scale.
struct FilteredLayer {
  Planes planes;          // 3
  FilteredPoints points;  // where points were asked for
};

/// Filters one layer: cross-filters its halves, once and then what that leaves of them once more, and blends
/// per pixel what is nearest the truth by estimate, the untouched input among the choices. `points`, which
/// may be null, are read from the same manifolds and blended by their pixels' choice. Where only one half is
/// known anywhere there is nothing to choose by: one wide filtering. Threads: identical for any pool.
FilteredLayer FilterLayer(Halves halves, const Planes& geometry, const LayerParams& params,
                          const SlicePoints* points, TaskPool* pool);

/// One pass over the mean of the halves, guided by its own patches and the geometry.
FilteredLayer FilterLayerOnce(Halves halves, const Planes& geometry, const PatchParams& patches,
                              const OnePassParams& params, const SlicePoints* points, TaskPool* pool);

}  // namespace lumifold::filter
