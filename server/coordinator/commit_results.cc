#include "server/coordinator/commit_results.h"

#include <spdlog/logger.h>

#include <string>

#include "absl/strings/str_cat.h"
#include "proto/logging/fields.h"

namespace lumifold::server {
namespace {

using job::JobId;

/// Units of a frame may be lost this often before its job fails: a disk that loses them each time is broken.
constexpr int kMaxLosses = 3;

}  // namespace

bool CommitResults::IsWanted(const JobId& job) {
  return FarmState::View(state_)->jobs.FindActive(job) != nullptr;
}

void CommitResults::OnCommitted(const std::vector<AcceptedUnit>& units, const absl::Status& status) {
  FarmState::Change farm(state_);
  if (!status.ok()) {
    return farm->FailJob(units.front().stored.unit.job,
                         absl::StrCat("units cannot be committed: ", std::string(status.message())));
  }
  for (const AcceptedUnit& unit : units) {
    farm->CountCommitted(unit);
    farm->workers.Acknowledge(unit.worker, unit.stored.unit, unit.stored.attempt);
  }
}

void CommitResults::OnStorageAvailable() {
  FarmState::Change farm(state_);
  farm->frames.Wake();
}

void CommitResults::OnUnitsLost(const JobId& job, int32_t frame, const absl::Status& cause,
                                const absl::StatusOr<std::vector<ledger::UnitRecord>>& lost) {
  FarmState::Change farm(state_);
  ActiveJob* const active = farm->jobs.FindActive(job);
  if (active == nullptr) return;
  const std::string error(cause.message());
  if (!lost.ok()) return farm->FailJob(job, std::string(lost.status().message()));
  if (lost->empty()) return farm->FailJob(job, error);
  if (++active->losses[frame] > kMaxLosses) {
    return farm->FailFrame({job, frame}, absl::StrCat("units of frame ", frame, " were lost ", kMaxLosses + 1,
                                                      " times: ", error));
  }
  farm->RevokeUnits(job, *lost);
  resources_->log().error("event=units_lost job={} frame={} units={} error={}", job.value(), frame,
                          lost->size(), logging::Quoted(error));
}

void CommitResults::OnUnitsDiscarded(const FrameKey& frame, const std::vector<job::UnitKey>& units,
                                     const absl::StatusOr<std::vector<ledger::UnitRecord>>& lost) {
  const auto& [job, number] = frame;
  FarmState::Change farm(state_);
  if (farm->jobs.FindActive(job) == nullptr) return;
  if (!lost.ok()) return farm->FailJob(job, std::string(lost.status().message()));
  if (const auto rounds = farm->scheduler.frames().RoundsOf(job, number);
      rounds != nullptr && rounds->estimated() > 1) {
    // Where its later samples went was decided by wrong pixels.
    return farm->FailJob(
        job, absl::StrCat("frame ", number,
                          ": a worker delivered wrong pixels, and samples went by them; retry it"));
  }
  for (const job::UnitKey& unit : units) farm->scheduler.units().Revoke({job, unit});
  farm->RevokeUnits(job, *lost);
  farm->frames.MarkStale(frame);
  resources_->log().warn("event=units_discarded job={} frame={} units={}", job.value(), number, lost->size());
}

}  // namespace lumifold::server
