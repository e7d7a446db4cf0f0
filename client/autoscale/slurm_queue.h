#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "client/autoscale/policy/types.h"

namespace lumifold::autoscale {

/// The option of squeue that prints what ParseSlurmQueue reads: the name is last, for it may have any
/// character. Times are in UTC (TZ).
inline constexpr char kSlurmQueueFormat[] = "--format=%A|%T|%S|%e|%C|%r|%j";

/// Name of the Slurm job that is the request of a slot. Two jobs of one name never run at the same time
/// (--dependency=singleton), so that each slot has at most one worker.
std::string SlurmJobName(absl::string_view farm, int slot);

/// The requests of one farm among squeue's lines, by id; lines of other names are skipped. Of several jobs of
/// one slot that have not ended, the one that runs, else the oldest, is the request; the others are
/// duplicates. A state that is not known counts as pending, so that nothing is started twice.
/// Errors: kDataLoss naming the line.
absl::StatusOr<std::vector<Request>> ParseSlurmQueue(absl::string_view text, absl::string_view farm);

}  // namespace lumifold::autoscale
