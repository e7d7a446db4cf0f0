#pragma once

#include <vector>

#include "filter/layers/halves.h"

namespace lumifold::filter {

/// One way a layer was filtered: half A guided by half B and the reverse, so that each is independent of the
/// noise it meets.
struct Candidate {
  Planes a;
  Planes b;
};

struct SelectionParams {
  int error_radius = 3;    // window over which squared errors are averaged before they are compared
  int region_radius = 12;  // wider window they are drawn towards where the narrow one says little
  float region_share = 0.25f;
  int blend_radius = 4;  // window over which the choice is smoothed
};

/// Per pixel, the share of each candidate and, first, of the untouched input: W x H weights that sum to 1 at
/// valid pixels. The error of a candidate against the truth is estimated without knowing it, as ((gA - B)^2 +
/// (gB - A)^2 - (A - B)^2) / 2 - (gA - gB)^2 / 4; that of the input as its variance; both relative to the
/// light (ErrorWeight). `raw_variance`: PixelVariance of the input before fireflies were taken out. At least
/// one candidate. Source: Rousselle et al. 2012 and Bitterli et al. 2016, by halves. Threads: identical for
/// any pool.
Planes SelectCandidates(const Halves& halves, const Planes& raw_variance,
                        const std::vector<Candidate>& candidates, const SelectionParams& params,
                        TaskPool* pool);

}  // namespace lumifold::filter
