#pragma once

#include <vector>

#include "filter/image/layered_image.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/image/rect.h"
#include "filter/layers/features.h"
#include "filter/layers/halves.h"

namespace lumifold::filter {

/// One noisy layer of light with all that is needed to filter it and to put it back into the picture, to
/// which it gives mean * factor: D and I with T, G with S, and the same of each level of reflection.
struct Product {
  ConstColorView mean;    // the film's size, as all views here
  ConstColorView factor;  // the chain's throughput in it
  HalvesView halves;
  Rect box;         // the part of the frame it is filtered in: where it is, and a margin
  Plane validity;   // of the box: the part of each pixel that its surface covers; 0: not to be filtered
  Planes geometry;  // of the box: the features that guide it besides its own patches
  bool is_glossy = false;      // G, of the surfaces seen first
  bool is_level = false;       // seen in mirrors or through glass
  bool is_difference = false;  // see Halves: the remainder
  Plane picture_light;         // of the box; see Halves
};

struct ProductParams {
  float sigma_normal = kSigmaNormal;  // what normals are divided by to guide
  bool cuts_frame = false;            // D and I are filtered in the box round all that is hit
};

/// The layers of a film that have anything to filter: direct and indirect first, then glossy, then the levels
/// the film has, deepest first. Keeps views of `film`. Not finite factors count as they are: Recombine()
/// guards.
std::vector<Product> ProductsOf(const LayeredImage& film, const ProductParams& params, TaskPool* pool);

/// The part of the views inside `box`.
HalvesView Crop(const HalvesView& halves, const Rect& box);

}  // namespace lumifold::filter
