#pragma once

#include "absl/status/statusor.h"
#include "worker/scene/document.h"

namespace lumifold::scene {

/// Summary of a document's animations.
struct AnimationSummary {
  bool moves = false;           // at least one property has more than one keyframe
  double duration_seconds = 0;  // from 0 to the last keyframe
};

/// Evaluates the animations of `document` that `options` choose, at its time, and overwrites translation,
/// rotation, scale and morph weights of the nodes, and pointed properties. If several channels of an
/// animation target one property, the last one applies. Nodes with a matrix are unchanged and counted.
/// Errors: kInvalidArgument naming animation and channel, for nodes and accessors that do not exist or do not
/// fit, and times that decrease; kNotFound for an animation that does not exist; kResourceExhausted over the
/// limit of keyframes.
absl::StatusOr<AnimationSummary> PoseNodes(const LoadOptions& options, Document* document,
                                           Diagnostics* diagnostics);

}  // namespace lumifold::scene
