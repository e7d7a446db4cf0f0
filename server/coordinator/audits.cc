// What follows from audits: workers that delivered wrong pixels are blocked and their units rendered again.
#include <spdlog/logger.h>

#include <algorithm>
#include <map>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/logging/fields.h"
#include "server/coordinator/coordinator.h"

namespace lumifold::server {

void Coordinator::FollowAudits() {
  for (const scheduler::FaultyWorker& faulty : scheduler_.TakeFaulty()) ConvictWorker(faulty);
  for (const auto& [job, frame] : scheduler_.TakeSettledFrames()) {
    if (!scheduler_.IsFrameCommitted(job, frame)) continue;
    options_.log->info("event=frame_committed job={} frame={}", job.value(), frame);
    QueueDue({job, frame});
  }
}

void Coordinator::ConvictWorker(const scheduler::FaultyWorker& faulty) {
  std::map<FrameKey, std::vector<job::UnitKey>> units;
  for (const job::UnitRef& unit : faulty.units) units[{unit.job, unit.key.frame}].push_back(unit.key);
  for (const auto& [frame, keys] : units) committer_->Discard(frame, keys);
  if (faulty.reason.empty()) return;
  options_.log->error("event=worker_faulty worker={} units={} reason={}", absl::StrCat("-/", faulty.name),
                      faulty.units.size(), logging::Quoted(faulty.reason));
  // Last: after a crash in between, the audits that a restart begins again find the rest of its units.
  committer_->Write([this, faulty] { return store_->BlockWorker(faulty.name, faulty.reason); },
                    [this, faulty](const absl::Status& status) {
                      if (status.ok()) return;
                      options_.log->error("event=ledger_failed worker={} error={}",
                                          absl::StrCat("-/", faulty.name),
                                          logging::Quoted(std::string(status.message())));
                    });
}

void Coordinator::OnUnitsDiscarded(const FrameKey& frame, const std::vector<job::UnitKey>& units,
                                   const absl::StatusOr<std::vector<ledger::UnitRecord>>& lost) {
  const auto& [job, number] = frame;
  absl::MutexLock lock(&mutex_);
  const auto active = active_jobs_.find(job);
  if (active == active_jobs_.end()) return;
  if (!lost.ok()) return EndJob(job, v1::JOB_STATE_FAILED, std::string(lost.status().message()));
  if (const auto rounds = scheduler_.RoundsOf(job, number); rounds != nullptr && rounds->estimated() > 1) {
    // Where its later samples went was decided by wrong pixels.
    return EndJob(job, v1::JOB_STATE_FAILED,
                  absl::StrCat("frame ", number,
                               ": a worker delivered wrong pixels, and samples went by them; retry it"));
  }
  for (const job::UnitKey& unit : units) scheduler_.RevokeUnit({job, unit});
  for (const ledger::UnitRecord& record : *lost) {
    scheduler_.RevokeUnit(record.unit);
    active->second.bad_samples -= record.bad_samples;
  }
  if (finished_frame_ == frame) finished_in_vain_ = true;
  options_.log->warn("event=units_discarded job={} frame={} units={}", job.value(), number, lost->size());
  changed_jobs_.insert(job);
  housekeeping_.Notify();
  GrantLeases();
}

}  // namespace lumifold::server
