#pragma once

#include <vector>

#include "filter/denoise/settings.h"
#include "filter/layers/choice.h"
#include "filter/layers/fragments.h"
#include "filter/layers/frame.h"
#include "filter/layers/recombination.h"
#include "filter/layers/remainder.h"

namespace lumifold::filter {

/// Adds what sub-samples change of E on mixed pixels.
void AddEmissionChange(const FragmentSet& set, FrameChange* change);

/// Subtracts what the samples of a half have of E beyond its mean over both, which the remainder is without
/// already.
void SubtractEmissionOfHalves(const FragmentSet& set, Remainder* rest);

/// Moves *change towards each of the candidates in turn, and at last towards C without its fireflies, as far
/// as the halves of C show that it lowers the error (Choice): the last one by the share of C with them, as
/// without them the halves of rare light agree by selection. `mixed`: as Halves::is_mixed.
/// Result:  the share of the latter, W x H.
/// Threads: identical for any pool.
Plane ChooseChange(const Frame& frame, const Plane& mixed, const std::vector<FrameChange>& candidates,
                   const LayerSettings& settings, TaskPool* pool, FrameChange* change);

}  // namespace lumifold::filter
