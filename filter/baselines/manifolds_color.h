#pragma once

#include "filter/baselines/baseline.h"

namespace lumifold::filter {

/// "manifolds-color": adaptive manifolds on the picture as displayed, which is signal and guide at once; or
/// guided by its patches (the NLM form). The height of the tree follows the authors' formula, and the result
/// is the slice itself: adjusting outliers would bring fireflies back.
/// Source:  Gastal & Oliveira 2012.
Baseline ManifoldsColorBaseline();

}  // namespace lumifold::filter
