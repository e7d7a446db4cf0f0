#pragma once

#include <cstdint>
#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "lumifold/v1/job.pb.h"

namespace lumifold::job {

/// Whether a worker has to plan the job before it can be divided into units.
bool NeedsPlan(const v1::JobSpec& spec);

/// The spec of the job's first frame alone: what a plan unit is of.
v1::JobSpec FirstFrameOf(v1::JobSpec spec);

/// The plan of a job that models everything, with the decisions that it forces. `spec` has tile size and pass
/// samples.
/// Errors: those of decisions::ParseForced.
absl::StatusOr<v1::Plan> FullPlan(const v1::JobSpec& spec);

/// The spec of a planned job: with the plan, and with its tile size and pass samples where those of `spec`
/// are 0. `spec` is normalised and needs a plan.
/// Errors: kInvalidArgument naming what is wrong with the plan: a decision is missing or out of order, a
/// value is out of range or is not the one that the job forces, a text or the plan is too long, a number is
/// negative or not finite, or tile_order is not an order of the tiles.
absl::StatusOr<v1::JobSpec> PlannedSpec(const v1::JobSpec& spec, const v1::Plan& plan);

/// Checks that the order of tiles of a spec, whose plan, sizes and samples are valid, has each tile of a
/// frame once, or none.
/// Errors: kInvalidArgument.
absl::Status CheckTileOrder(const v1::JobSpec& spec);

/// The inverse of PlannedSpec: what was submitted.
v1::JobSpec UnplannedSpec(v1::JobSpec spec);

/// Memory that a worker needs for the job: that of its plan; without one at least that of the scene's files.
uint64_t MemoryNeedOf(const v1::JobSpec& spec);

/// The value of a decision; that which models everything where the job has no plan.
int ValueOf(const v1::JobSpec& spec, std::string_view decision);

}  // namespace lumifold::job
