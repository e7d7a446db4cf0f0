#pragma once

#include <vector>

#include "absl/status/statusor.h"
#include "absl/types/span.h"
#include "filter/baselines/method_info.h"
#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "tests/charts/methods/samples/sample_set.h"

namespace lumifold::charts {

/// A method that reads data a film does not hold: single samples, or rays of its own.
struct SampleMethod {
  filter::MethodInfo info;
  bool uses_samples = true;  // if not, a set of 0 samples per pixel is enough
  bool uses_guide = false;   // whether SampleSet::guide_seconds are part of its cost
  /// `values`: one for each parameter, in their order and within their ranges. Result: R G B, finite, with
  /// the same bits for any pool.
  absl::StatusOr<Picture> (*filter)(const SampleSet& set, absl::Span<const float> values,
                                    TaskPool* pool) = nullptr;
};

/// All of them, in the order tables list them.
const std::vector<SampleMethod>& SampleMethods();

}  // namespace lumifold::charts
