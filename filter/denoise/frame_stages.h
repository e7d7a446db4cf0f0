#pragma once

#include <vector>

#include "filter/denoise/layer_stages.h"
#include "filter/denoise/stage.h"
#include "filter/edges/antialiasing.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/frame.h"
#include "filter/layers/product.h"
#include "filter/layers/remainder.h"

namespace lumifold::filter {

/// A frame on its way through the stages. Each stage reads what the ones before it wrote.
struct FrameState {
  const Frame& frame;
  const Settings& settings;
  const std::vector<LayerStage>& layer_stages;
  const SwitchedOff& off;
  const StageWatch& watch;
  TaskPool* pool;

  EdgePoints edge_points;                 // where D and I are read at sub-samples
  FilteredPoints direct_at_points;        // D there
  FilteredPoints indirect_at_points;      // I there
  std::vector<FilteredProduct> products;  // D, I, lobes, levels
  Remainder remainder;
  Picture picture;         // F, from recombination on
  Planes coverage_change;  // 3, W x H: what F has of the truth that C has not
};

struct FrameStage {
  StageInfo info;
  bool (*is_on)(const FrameState&);
  void (*run)(FrameState*);
};

const std::vector<FrameStage>& DefaultFrameStages();

/// Those of the published method.
const std::vector<FrameStage>& PublishedFrameStages();

}  // namespace lumifold::filter
