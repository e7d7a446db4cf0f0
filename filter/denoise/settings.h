#pragma once

#include "filter/layers/nlm_space.h"
#include "filter/layers/product.h"
#include "filter/layers/selection.h"
#include "filter/manifold/manifold_filter.h"

namespace lumifold::filter {

/// One filtering of a layer's mean, without candidates to choose from. The defaults are the paper's.
struct SingleFilteringParams {
  float range_factor = 1.8f;  // sigma_q over the layer's noise
  ManifoldParams manifolds;
};

/// How one layer is filtered. The defaults are those of the "default" method.
struct LayerSettings {
  PatchParams patches;                           // of the noisy layer
  PatchParams second_patches = {1, 3, 6, 0.95};  // of the first filtering's result
  float range_factor = 1.8f;         // sigma_q of the first filtering, over the noise of the half that guides
  float second_range_factor = 0.3f;  // sigma_q of the second, over the same
  float knee = 0.2f;                 // of the stabilised guide, over the layer's mean
  // The manifolds of both filterings are close to each other, since they have to follow fine detail.
  ManifoldParams first_manifolds = {.sigma_s = 7, .height = 5, .cell = 4, .is_first_order = true};
  float first_reach_px = 12;
  ManifoldParams second_manifolds = {.sigma_s = 2, .height = 4};
  float second_reach_px = 6;  // in a picture of 128x128 (picture_size.h)
  SelectionParams selection;
  /// Where one half alone is known, its noise is a rough guess, and geometry guides far better than patches.
  SingleFilteringParams single = {.range_factor = 8, .manifolds = {.sigma_s = 8, .height = 5}};
  bool has_normals = true;  // among the features
  bool has_depth = true;
};

/// How a frame is filtered.
struct Settings {
  LayerSettings layer;
  ProductParams products;
  /// Pixels of more samples are not antialiased: CoverageChange(), RelightEdges() and RegressEdges() leave
  /// nothing to gain there, and reading light at sub-samples takes two fifths of the filter's time.
  float max_antialiased_samples = 8;
};

/// The "default" method's settings for a picture of this size.
Settings DefaultSettings(int width, int height);

/// The method as published.
Settings PublishedSettings();

}  // namespace lumifold::filter
