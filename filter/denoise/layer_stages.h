#pragma once

#include <vector>

#include "filter/denoise/stage.h"
#include "filter/edges/antialiasing.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/halves.h"
#include "filter/layers/product.h"
#include "filter/layers/selection.h"
#include "filter/manifold/manifold_filter.h"

namespace lumifold::filter {

/// One filtering of a layer: half A guided by half B and the reverse.
struct Filtering {
  Candidate picture;
  SlicedPoints points_a;  // read from each half's manifolds; empty where no points were asked for
  SlicedPoints points_b;
};

/// A filtered layer, in its halves' unit.
struct FilteredLayer {
  Planes planes;          // 3
  FilteredPoints points;  // where points were asked for
};

/// One layer of light on its way through the stages. Each stage reads what the ones before it wrote.
struct LayerState {
  const LayerSettings& settings;
  const Planes& geometry;
  const SlicePoints* points;  // where D and I are also wanted between pixels; null: nowhere
  TaskPool* pool;

  Halves halves;
  Planes raw;                         // 3: X, with its fireflies
  Planes raw_variance;                // 3: variance of X
  float guide_noise = 0;              // RMS noise of one half of the first filtering's guide
  Planes removed;                     // 3: what was removed as fireflies; empty: nothing was
  std::vector<Filtering> candidates;  // the first filtering, then the second
  Planes firefly_energy;              // 3: what was removed, spread; empty: nothing
  Planes shares;                      // of raw, then of each candidate; empty: the last candidate has all
  FilteredLayer result;
};

struct LayerStage {
  StageInfo info;
  bool (*is_on)(const LayerState&);
  void (*run)(LayerState*);
};

/// The stages that each layer goes through by default: cross-filtering of its halves, a second filtering of
/// what the first leaves of them, and a choice between these and the noisy layer per pixel.
const std::vector<LayerStage>& DefaultLayerStages();

/// The published method: one filtering, guided by the layer's own patches.
const std::vector<LayerStage>& PublishedLayerStages();

/// Runs the stages that are on over one product. `points`, which may be null: places in the product's box.
/// Result: planes of the box's size in the film's unit; the values at the points likewise.
FilteredLayer RunLayer(const std::vector<LayerStage>& stages, const LayerSettings& settings,
                       const Product& product, const SlicePoints* points, const SwitchedOff& off,
                       const StageWatch& watch, TaskPool* pool);

}  // namespace lumifold::filter
