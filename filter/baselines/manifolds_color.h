#pragma once

#include "filter/baselines/baseline.h"

namespace lumifold::filter {

/// "manifolds-color": adaptive manifolds on the displayed picture, guided by its own colours or by its
/// patches (the NLM form). The height of the tree follows the authors' formula. The result is the slice
/// itself: the published adjustment of outliers would bring fireflies back.
/// Source:  Gastal & Oliveira 2012.
Baseline ManifoldsColorBaseline();

}  // namespace lumifold::filter
