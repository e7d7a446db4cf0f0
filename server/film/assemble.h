#pragma once

#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"
#include "filter/image/layered_image.h"
#include "filter/image/parallel.h"
#include "lumifold/v1/job.pb.h"
#include "server/scheduler/unit.h"

namespace lumifold::film {

/// Gives the pixels of a merged unit; called from many threads at once.
using UnitSource = absl::FunctionRef<absl::StatusOr<LayeredImage>(const scheduler::UnitKey&)>;

/// Makes a frame's film from its units: adds the sums of each tile's passes, in pass order and in double, and
/// divides by the counts.
/// Shapes: width x height of the spec (normalised). Channels: what FilterFilm reads, and Z, id.Y and A.
/// Edges: where a half has no good sample its mean is 0 and its count 0.
/// Errors: those of `read`; kInvalidArgument for a unit without the channels or size of its kind.
/// Threads: the result is identical for any pool, null included, and for any order units arrived in.
absl::StatusOr<LayeredImage> AssembleFilm(const v1::JobSpec& spec, int32_t frame, UnitSource read,
                                          TaskPool* pool);

}  // namespace lumifold::film
