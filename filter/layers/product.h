#pragma once

#include <optional>
#include <vector>

#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/image/rect.h"
#include "filter/layers/features.h"
#include "filter/layers/frame.h"
#include "filter/layers/halves.h"

namespace lumifold::filter {

/// One noisy layer of light with all that is needed to filter it and to put it back into the picture, to
/// which it contributes mean * factor.
struct Product {
  enum class Kind {
    kDirect,       // D with T
    kIndirect,     // I with T
    kGlossy,       // G with S
    kTransmitted,  // transmitted light of the first surface with its transmittance
    kLevel,        // D and I of a level, with the throughput of the chain times T
    kRemainder,    // what all other layers and E leave of C, with factor 1
    kBlurred,      // the picture where its factors have noise, with factor 1
  };

  Kind kind = Kind::kDirect;
  ConstColorView mean;           // W x H, as all views here
  ConstColorView factor;         // empty: 1
  ColorOfHalves factor_of = {};  // of each half; empty like it
  HalvesView halves;
  ColorOfHalves rest_of = {};  // of each half: what all products and E leave of C; empty: not known
  Rect box;                    // part of the frame that is filtered: the layer's extent and a margin
  Plane validity;       // of the box: part of each pixel that the layer's surface covers; 0: not filtered
  Planes geometry;      // of the box: the features that guide the filter besides the layer's own patches
  Plane picture_light;  // of the box; see Halves
  Plane is_mixed = {};  // the same
};

struct ProductParams {
  GeometryRanges ranges;               // of the features
  bool cuts_frame = false;             // D and I are filtered in the box around all hits, not in the frame
  bool has_levels = true;              // else levels stay in the remainder
  bool remainder_sees_levels = false;  // features of the remainder are those of SeenSurface
};

/// The layers of a film that have anything to filter: direct and indirect first, then the lobes, then the
/// levels. Keeps views of the frame's film.
std::vector<Product> ProductsOf(const Frame& frame, const ProductParams& params, TaskPool* pool);

/// A picture in two halves, in which the noise of its factors is left. 3 planes each, W x H.
struct BlurredPicture {
  Planes a;
  Planes b;
  Planes mean;
};

/// The picture as a product of factor 1, valid where its factors have noise (HasNoisyFactors); none where
/// they have it nowhere. It has no features but its patches: those of the first surface are as noisy as the
/// picture. Keeps views of `picture`.
std::optional<Product> BlurredProduct(const Frame& frame, const BlurredPicture& picture);

/// The product's halves inside its box, scaled and made safe to compute with.
Halves HalvesOf(const Product& product, TaskPool* pool);

/// Converts filtered light of the halves' unit, of the covered part of each pixel, to means over pixels in
/// the film's. `planes`: of the box's size.
void RestoreUnits(const Product& product, float scale, TaskPool* pool, Planes* planes);

}  // namespace lumifold::filter
