#pragma once

#include "filter/denoise/layer_stages.h"

namespace lumifold::filter {

/// All stages from the first filtering to the choice of the noisy layer, in one call of the device of the
/// pool, if it can. Sets the result and what it returns, and that they are done.
/// Threads: identical for any pool.
bool FilterOnDevice(LayerState* state);

}  // namespace lumifold::filter
