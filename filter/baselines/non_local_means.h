#pragma once

#include "filter/baselines/baseline.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

struct NonLocalMeansParams {
  int search_radius = 9;  // px, >= 0
  int patch_radius = 3;   // px, >= 0
  float strength = 0.5f;  // k: how many deviations two alike patches may differ by
};

/// Averages `signals` with weights from how alike the patches of `guide` are, beyond what its noise explains:
/// w = exp(-max(0, mean over patch and channels of [(u_p - u_q)^2 - (v_p + min(v_p, v_q))] / (1e-7 + k^2 (v_p
/// + v_q)))), each term cut at 1e4.
/// Shapes:  signals: C planes; guide: 3 planes about 1; variance: 3 planes >= 0, of the guide: W x H, finite.
/// Edges:   patches are clamped, pixels outside the picture give nothing.
/// Threads: safe concurrently; the result is identical for any pool.
/// Source:  Rousselle, Knaus & Zwicker 2012.
Planes NonLocalMeans(const Planes& signals, const Planes& guide, const Planes& variance,
                     const NonLocalMeansParams& params, TaskPool* pool);

/// "nlm": on the film's noisy picture in linear light, half A weighed by half B and the reverse; the variance
/// of a half is that of the two over 7x7 pixels, a film holding none of single samples.
Baseline NonLocalMeansBaseline();

}  // namespace lumifold::filter
