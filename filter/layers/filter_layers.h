#pragma once

#include "absl/functional/function_ref.h"
#include "filter/image/layered_image.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/halves.h"

namespace lumifold::filter {

/// Filters one layer of light, given as halves and the features of its geometry. Result: 3 planes in the
/// halves' unit.
using LayerFilter = absl::FunctionRef<Planes(const Halves& halves, const Planes& geometry)>;

/// Filters each layer of light of the film, and the remainder, by `filter`, and recombines them: what turns a
/// filter of one layer into a method. No edge is antialiased. `film`: as FilterFilm() describes it.
/// Threads: identical for any pool as far as `filter` is.
Picture FilterLayers(const LayeredImage& film, LayerFilter filter, TaskPool* pool);

}  // namespace lumifold::filter
