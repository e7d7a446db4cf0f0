#pragma once

#include <array>
#include <vector>

#include "filter/denoise/stage.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/halves.h"
#include "filter/layers/product.h"
#include "filter/layers/recombination.h"
#include "filter/manifold/manifold_filter.h"

namespace lumifold::filter {

/// One layer of light on its way through the stages. Each stage reads what the ones before it wrote.
struct LayerState {
  const LayerSettings& settings;
  const SwitchedOff& off;
  const Product& product;
  const Planes& geometry;
  TaskPool* pool;

  Halves halves;
  LayerFragments fragments;       // their light in the halves' unit
  float guide_noise = 0;          // RMS noise of one half of the first filtering's guide
  std::array<Planes, 2> removed;  // of each half, 3: what was removed as fireflies; empty: nothing was
  std::array<Planes, 2> missing;  // FilteredLayer::missing
  std::vector<Candidate> candidates;
  std::array<Planes, 2> firefly_energy;  // of each half, 3: what was removed, spread; empty: nothing
  Candidate result;
  Planes returned;       // FilteredLayer::returned, in the halves' unit
  bool is_done = false;  // by the device: the stages from the first filtering on have nothing to do
};

struct LayerStage {
  StageInfo info;
  bool (*is_on)(const LayerState&);
  void (*run)(LayerState*);
};

const std::vector<LayerStage>& DefaultLayerStages();

/// Runs the stages on a layer. A layer without light is not filtered.
FilteredLayer RunLayer(const std::vector<LayerStage>& stages, const LayerSettings& settings,
                       const Product& product, LayerFragments fragments, const SwitchedOff& off,
                       const StageWatch& watch, TaskPool* pool);

}  // namespace lumifold::filter
