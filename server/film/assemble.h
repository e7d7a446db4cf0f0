#pragma once

#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"
#include "filter/image/edged_image.h"
#include "filter/image/parallel.h"
#include "lumifold/v1/job.pb.h"
#include "server/scheduler/unit.h"

namespace lumifold::film {

/// Gives a merged unit; called from many threads at once.
using UnitSource = absl::FunctionRef<absl::StatusOr<EdgedImage>(const scheduler::UnitKey&)>;

/// Makes a frame's film from its units: adds the sums of each tile's passes, in pass order and in double, and
/// divides by the counts.
/// Shapes: pixels: width x height of the spec (normalised). Channels: for each of layers::kHalved the mean
/// and
///         its halves' means, layers::kWhole, the counts, the channels of geometry units; and the same of
///         every level some unit carries, where D and I are means over the samples counted there, T and E
///         means over all samples of the pixel, and a tile without the level has zeros. edges: those of all
///         geometry units, in the order of the frame's rows.
/// Edges: where a half has no good sample its mean is 0 and its count 0.
/// Errors: those of `read`; kInvalidArgument for a unit that is not what CheckUnitLayout and CheckEdges ask.
/// Threads: the result is identical for any pool, null included, and for any order units arrived in.
absl::StatusOr<EdgedImage> AssembleFilm(const v1::JobSpec& spec, int32_t frame, UnitSource read,
                                        TaskPool* pool);

}  // namespace lumifold::film
