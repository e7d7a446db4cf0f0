#pragma once

#include <vector>

#include "filter/denoise/layer_stages.h"
#include "filter/layers/choice.h"
#include "filter/layers/fragments.h"
#include "filter/layers/frame.h"
#include "filter/layers/product.h"

namespace lumifold::filter {

FrameChange NoChange(const Frame& frame);

/// Adds what sub-samples change of E on mixed pixels. E has no halves: both get the same.
void AddEmissionChange(const FragmentSet& set, FrameChange* change);

/// Adds (filtered - noisy) * factor of half `h` of a product to *change, and subtracts noisy * factor from *rest, which
/// may be null. On mixed pixels both are sums over the fragments: filtered light times coverage times T, noisy light
/// times the share of the samples times T.
/// Threads: identical for any pool.
void AddFiltered(const Product& product, const FilteredLayer& layer, size_t h, TaskPool* pool, Planes* rest,
                 Planes* change);

/// The mean of two halves of planes, weighted by the pixels' sample counts.
Planes MeanOfHalves(const Frame& frame, const Planes& a, const Planes& b, TaskPool* pool);

/// C + the mean of the change.
Picture PictureOf(const Frame& frame, const FrameChange& change, TaskPool* pool);

/// Moves *change towards each of the candidates in turn, and at last towards 0, which is C, as far as the halves of C
/// show that it lowers the error (Choice). `mixed`: as Halves::is_mixed.
/// Threads: identical for any pool.
void ChooseChange(const Frame& frame, const Plane& mixed, const std::vector<FrameChange>& candidates,
                  const ChoiceParams& params, TaskPool* pool, FrameChange* change);

}  // namespace lumifold::filter
