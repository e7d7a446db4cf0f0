#pragma once

#include "filter/baselines/baseline.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

struct NonLocalMeansParams {
  int search_radius = 9;  // px, >= 0
  int patch_radius = 3;   // px, >= 0
  float strength = 0.5f;  // k: standard deviations by which similar patches may differ
};

/// Averages `signals`, weighted by the similarity of the patches of `guide` after its noise is subtracted:
/// w = exp(-max(0, mean over patch and channels of [(u_p - u_q)^2 - (v_p + min(v_p, v_q))] / (1e-7 + k^2 (v_p
/// + v_q)))), each term clamped to 1e4.
/// Shapes:  signals: C planes; guide: G planes about 1; variance: G planes >= 0, of the guide: W x H, finite.
/// Edges:   patches are clamped; pixels outside the picture are skipped.
/// Threads: safe concurrently; the result is identical for any pool.
/// Source:  Rousselle, Knaus & Zwicker 2012.
Planes NonLocalMeans(const Planes& signals, const Planes& guide, const Planes& variance,
                     const NonLocalMeansParams& params, TaskPool* pool);

/// "nlm": on the film's noisy picture in linear light, half A with weights from half B and the reverse. The
/// variance of a half is HalfVariance().
Baseline NonLocalMeansBaseline();

}  // namespace lumifold::filter
