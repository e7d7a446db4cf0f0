#pragma once

#include "filter/baselines/baseline.h"

namespace lumifold::filter {

/// The published height of the tree: at least 2, growing with log2(sigma_s) and with 1 - sigma_r. Patches
/// span more dimensions than colours: the authors' programs add two levels for them.
/// Source:  Gastal & Oliveira 2012, Eq. (12), and their programs.
int TreeHeight(float sigma_s, float sigma_r, bool has_patches);

/// "manifolds-color": adaptive manifolds on the displayed picture, guided by its own colours or by its
/// patches (the NLM form). The height of the tree follows the authors' formula. The result is the slice
/// itself: the published adjustment of outliers would bring fireflies back.
/// Source:  Gastal & Oliveira 2012.
Baseline ManifoldsColorBaseline();

}  // namespace lumifold::filter
