#pragma once

#include <array>

#include "absl/functional/function_ref.h"
#include "filter/image/layered_image.h"
#include "filter/image/parallel.h"
#include "filter/manifold/layer_filter.h"

namespace lumifold::filter {

// The functions here take a film and its edge set as FilterFilm() in filter/methods.h describes them, all
// channels there; `edges` may be null.

/// What takes the noise out of one layer, given as halves about 1 and the features that guide it: see
/// FilterLayer.
using LayerFilter =
    absl::FunctionRef<FilteredLayer(Halves halves, const Planes& geometry, const SlicePoints* points)>;

/// Filters each layer of light the film has, and what they leave of C, by `filter`, and puts the picture
/// together again. Without edges `filter` is asked for no points and no edge is antialiased. Where
/// `edge_change` is not null, EdgeMeansChange() is added to the picture and stored there.
std::array<Plane, 3> FilterLayers(const LayeredImage& film, const LayeredImage* edges, LayerFilter filter,
                                  TaskPool* pool, Planes* edge_change = nullptr);

/// The default method: FilterLayer on each layer, T and E of edges steadied, what is left on edges and in
/// mirrors fitted, then the result drawn back to C where noise cannot explain what they differ by.
std::array<Plane, 3> Denoise(const LayeredImage& film, const LayeredImage* edges, TaskPool* pool);

/// The paper's own: FilterLayerOnce on each layer.
std::array<Plane, 3> DenoiseAsPublished(const LayeredImage& film, const LayeredImage* edges, TaskPool* pool);

}  // namespace lumifold::filter
