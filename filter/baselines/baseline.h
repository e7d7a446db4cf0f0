#pragma once

#include <vector>

#include "absl/types/span.h"
#include "filter/baselines/method_info.h"
#include "filter/image/layered_image.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"

namespace lumifold::filter {

/// A film, its edge set and its fragments (EdgedImage). Lists that are null or without channels are empty.
struct FilmView {
  const LayeredImage& pixels;
  const LayeredImage* edges = nullptr;
  const LayeredImage* fragments = nullptr;
};

/// A filter of a finished film that ours is compared with. A baseline does what its source publishes and no
/// more: only `paper` reads the edge set, and none shrinks its result towards the input.
struct Baseline {
  MethodInfo info;
  /// Filters a film with the channels that FilterFilm() asks for. `values`: one for each parameter, in their
  /// order and within their ranges. Result: R G B of the film's size, finite whatever the film holds, with
  /// the same bits for any pool.
  Picture (*filter)(const FilmView& film, absl::Span<const float> values, TaskPool* pool) = nullptr;
};

/// All baselines, in the order tables list them.
const std::vector<Baseline>& Baselines();

}  // namespace lumifold::filter
