#pragma once

#include <vector>

#include "filter/denoise/frame_halves.h"
#include "filter/denoise/layer_stages.h"
#include "filter/denoise/stage.h"
#include "filter/image/filtered_picture.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/fragments.h"
#include "filter/layers/frame.h"
#include "filter/layers/product.h"
#include "filter/layers/remainder.h"

namespace lumifold::filter {

/// The progress of a filter, in which all layers count alike.
struct LayerProgress {
  const FilterProgress& told;  // empty: nobody is
  double layer_share = 0;      // of the time, about; two such shares follow those of the layers

  void Tell(double layers) const {
    if (told) told(layers * layer_share);
  }
};

/// A frame on its way through the stages. Each stage reads what the ones before it wrote. Planes are W x H;
/// those in pairs belong to half A and half B, each made without the samples of the other.
struct FrameState {
  const Frame& frame;
  const Settings& settings;
  const std::vector<LayerStage>& layer_stages;
  const SwitchedOff& off;
  const StageWatch& watch;
  LayerProgress progress;
  TaskPool* pool;

  FragmentSet fragments;
  Plane mixed;                          // MixedPixelsOf()
  Rect hits;                            // the box of D and I
  Remainder rest;                       // what the products and E leave of C
  FrameChange change;                   // F - C
  Planes returned;                      // AddReturned()
  std::vector<FrameChange> candidates;  // further pictures to choose from
  Picture picture;
};

struct FrameStage {
  StageInfo info;
  bool (*is_on)(const FrameState&);
  void (*run)(FrameState*);
};

const std::vector<FrameStage>& DefaultFrameStages();

}  // namespace lumifold::filter
