#pragma once

#include <array>
#include <vector>

#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/choice.h"
#include "filter/layers/frame.h"
#include "filter/layers/layer_fragments.h"
#include "filter/layers/product.h"
#include "filter/layers/remainder.h"

namespace lumifold::filter {

/// A picture of a layer in two halves, each made without the samples of the other; on edge pixels also for each
/// fragment.
struct Filtering {
  Candidate picture;                         // 3 planes each
  std::array<std::vector<float>, 2> points;  // 3 for each point of the layer's fragments, by half
};

/// A filtered layer and its fragments, in the film's unit: means over whole pixels.
struct FilteredLayer {
  Filtering light;
  LayerFragments fragments = {};
};

/// The same picture of a layer for both halves, without fragments. `planes`: 3, of the product's box.
FilteredLayer SameForBothHalves(Planes planes);

/// A layer without light.
FilteredLayer BlackLayer(const Product& product);

FrameChange NoChange(const Frame& frame);

/// Adds (filtered - noisy) * factor of a product, half by half, to *change, and subtracts noisy * factor from *rest,
/// which may be null. On mixed pixels both are sums over the fragments: filtered light times coverage times T, noisy
/// light times the share of the samples times T. Where a half has no sample of a layer, the layer's mean stands for it.
/// Unusable values count as 0.
/// Threads: identical for any pool.
void AddFiltered(const Product& product, const FilteredLayer& layer, TaskPool* pool, Remainder* rest,
                 FrameChange* change);

/// C + the mean of the change. What the filter left alone passes through to the last bit. W x H, R G B.
Picture PictureOf(const Frame& frame, const FrameChange& change, TaskPool* pool);

/// How far noise may have moved that picture: FilteredPicture::deviation. Unusable values count as 0.
Picture DeviationOf(const Frame& frame, const FrameChange& change, TaskPool* pool);

}  // namespace lumifold::filter
