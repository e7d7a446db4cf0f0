#pragma once

#include <functional>
#include <vector>

#include "absl/status/status.h"
#include "filter/denoise/settings.h"
#include "filter/denoise/stage.h"
#include "filter/image/filtered_picture.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/frame.h"

namespace lumifold::filter {

/// What measurements change of a method.
struct DenoiseOptions {
  SwitchedOff off;                             // as CheckSwitchedOff() allows
  StageWatch watch = {};                       // empty: nobody is told
  FilterProgress progress = {};                // likewise
  std::function<void(Settings*)> adjust = {};  // changes the settings first; empty: they stay
};

/// The default method: the stages of Stages(), in their order.
/// Shapes:  film and edge set: as FilterFilm() describes them, all channels there; `edges` may be null.
///          Result: W x H, R G B.
/// Threads: identical for any pool.
/// Source:  Gruzdev et al. 2015; each stage names its own.
Picture Denoise(const Frame& frame, TaskPool* pool, const DenoiseOptions& options = {});

/// The same with the deviation of the picture: both halves go to the end.
FilteredPicture DenoiseWithDeviation(const Frame& frame, TaskPool* pool, const DenoiseOptions& options = {});

/// The same without second filterings: two thirds of the time, and a picture that errs a little more, mostly
/// in the same places. To decide where samples go, not to be shown.
FilteredPicture DenoiseToEstimate(const Frame& frame, TaskPool* pool);

/// The stages of the default method in their order; those of a layer stand where layers are filtered.
const std::vector<StageInfo>& Stages();

/// What guides the default method and can be switched off.
const std::vector<GuideInfo>& Guides();

/// Errors: kInvalidArgument naming a stage or guide that does not exist or cannot be switched off.
absl::Status CheckSwitchedOff(const SwitchedOff& off);

/// What a block of a large frame has to see beyond its core: the widest window of any stage, in pixels. The
/// windows of successive stages are not added: blocks are cross-faded (blocks.h).
int DenoiseApron();

}  // namespace lumifold::filter
