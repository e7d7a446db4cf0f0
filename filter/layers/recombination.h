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

/// A filtered layer and its fragments, in the film's unit: means over whole pixels.
struct FilteredLayer {
  Candidate light;
  LayerFragments fragments = {};
  /// The energy of outliers that half A returns less that of half B, 3 planes; `light` has its mean in both.
  /// Empty: none.
  Planes returned = {};
  /// Of each half, 3 planes: by how much the products of its outliers exceed what C has of them. Empty:
  /// nothing.
  std::array<Planes, 2> missing = {};
};

/// The same picture of a layer for both halves, without fragments. `planes`: 3, of the product's box.
FilteredLayer SameForBothHalves(Planes planes);

/// A layer without light.
FilteredLayer BlackLayer(const Product& product);

FrameChange NoChange(const Frame& frame);

/// Subtracts noisy * factor of a product from *rest, half by half. On mixed pixels it is a sum over the
/// fragments: light times the share of the samples times T. Where a half has no sample of a layer, the
/// layer's mean stands for it. Unusable values count as 0.
/// Threads: identical for any pool.
void SubtractNoisy(const Product& product, const LayerFragments& fragments, TaskPool* pool, Remainder* rest);

/// Adds (filtered - noisy) * factor of a product, half by half, to *change: noisy as in SubtractNoisy(),
/// filtered light of fragments times coverage times T. FilteredLayer::missing is in the noisy product alone:
/// it is added to both *change and *rest, which may be null.
/// Threads: identical for any pool.
void AddFiltered(const Product& product, const FilteredLayer& layer, TaskPool* pool, Remainder* rest,
                 FrameChange* change);

/// Adds what a product returns of outliers, half A less half B, times the factor, to *returned: 3 planes, W x
/// H, which are made where something returns; empty before. On mixed pixels the factor is the mean over the
/// fragments by coverage.
/// Threads: identical for any pool.
void AddReturned(const Frame& frame, const Product& product, const FilteredLayer& layer, TaskPool* pool,
                 Planes* returned);

/// C + the mean of the change; no light becomes negative. What the filter left alone passes through to the
/// last bit. W x H, R G B.
Picture PictureOf(const Frame& frame, const FrameChange& change, TaskPool* pool);

/// How far noise may have moved that picture: FilteredPicture::deviation. Unusable values count as 0.
Picture DeviationOf(const Frame& frame, const FrameChange& change, TaskPool* pool);

/// FilteredPicture::returned, of a difference as AddReturned() makes it, which may be empty.
Picture DeviationOfReturned(const Frame& frame, const Planes& returned, TaskPool* pool);

}  // namespace lumifold::filter
