#pragma once

#include "filter/baselines/baseline.h"

namespace lumifold::filter {

/// "nfor": nonlinearly weighted first-order regression of the film's noisy picture on normals, albedo and
/// distance, half A fitted with the weights of half B and the reverse, at two bandwidths; the better of the
/// two per pixel and channel, by the error estimated across the halves; and a second pass over the result.
/// What is seen in mirrors and through glass lends its features to the pixel. Features count as free of
/// noise, a film holding no halves of them: they are not filtered first, so noise that a deep lens leaves in
/// the albedo passes into the fit. The halves stand for the sample variance as well, over 7x7 pixels.
/// Source:  Bitterli et al. 2016.
Baseline NforBaseline();

}  // namespace lumifold::filter
