#pragma once

#include <vector>

#include "filter/layers/halves.h"

namespace lumifold::filter {

/// A candidate: one filtering of a layer, half A guided by half B and the reverse, so that the weights do not
/// depend on the noise that they average.
struct Candidate {
  Planes a;
  Planes b;
};

struct SelectionParams {
  int error_radius = 3;        // px: window over which squared errors are averaged before they are compared
  int region_radius = 12;      // px: wide window whose average is mixed in, since the narrow one is noisy
  float region_share = 0.25f;  // of the wide window
  int blend_radius = 4;        // px: window over which the choice is smoothed
};

/// Chooses per pixel between the noisy layer and the candidates by estimated error. The squared error of a
/// candidate g is estimated as ((gA - B)^2 + (gB - A)^2 - (A - B)^2) / 2 - (gA - gB)^2 / 4, that of the noisy
/// layer as its variance; both are weighted by ErrorWeight().
/// Shapes:  raw_variance: PixelVariance of the layer before fireflies were removed; at least one candidate.
///          Result: shares, W x H, of the noisy layer and then of each candidate; they sum to 1 at valid
///          pixels.
/// Threads: identical for any pool.
/// Source:  Rousselle et al. 2012 and Bitterli et al. 2016, with halves in place of buffers.
Planes SelectCandidates(const Halves& halves, const Planes& raw_variance,
                        const std::vector<const Candidate*>& candidates, const SelectionParams& params,
                        TaskPool* pool);

/// Radius in pixels of what a share depends on.
int SelectionWindow(const SelectionParams& params);

}  // namespace lumifold::filter
