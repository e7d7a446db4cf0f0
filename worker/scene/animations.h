#pragma once

#include "absl/status/statusor.h"
#include "worker/scene/document.h"

namespace lumifold::scene {

/// Summary of a document's animations.
struct AnimationSummary {
  bool moves = false;           // at least one property has more than one keyframe
  double duration_seconds = 0;  // from 0 to the last keyframe
};

/// Evaluates all animations of `document` together at `time_seconds` and overwrites translation, rotation,
/// scale and morph weights of the nodes. If several channels target one property, the last one applies. Nodes
/// with a matrix are unchanged and counted. Errors: kInvalidArgument naming animation and channel, for nodes
/// and accessors that do not exist or do not fit, and times that decrease; kResourceExhausted over the limit
/// of keyframes.
absl::StatusOr<AnimationSummary> PoseNodes(double time_seconds, const LoadLimits& limits, Document* document,
                                           Diagnostics* diagnostics);

}  // namespace lumifold::scene
