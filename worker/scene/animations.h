#pragma once

#include "absl/status/statusor.h"
#include "worker/scene/document.h"

namespace lumifold::scene {

/// What a document's animations amount to.
struct AnimationSummary {
  bool moves = false;           // some property has more than one keyframe
  double duration_seconds = 0;  // from 0 to the last keyframe
};

/// Moves the nodes of `document` to where all its animations together have them at `time_seconds`: their
/// translation, rotation, scale and morph weights are overwritten. Of several channels for one property the
/// last one counts. Nodes with a matrix stay as they are and are counted. Errors: kInvalidArgument naming
/// animation and channel, for nodes and accessors that do not exist or do not fit, and times that decrease;
/// kResourceExhausted over the limit of keyframes.
absl::StatusOr<AnimationSummary> PoseNodes(double time_seconds, const LoadLimits& limits, Document* document,
                                           Diagnostics* diagnostics);

}  // namespace lumifold::scene
