#pragma once

#include <optional>
#include <set>
#include <string>
#include <vector>

#include "proto/threads/event.h"
#include "server/coordinator/cleanup.h"
#include "server/coordinator/farm.h"
#include "server/coordinator/farm_state.h"
#include "server/coordinator/resources.h"

namespace lumifold::server {

class Committer;
class JobChanges;

/// Carries out what changes of the farm lead to: ends of jobs and blocks of workers are orders to the
/// committer, and threads are woken.
/// Threads: safe; what an order leads to happens on the committer's thread.
class FarmRecords final : public FarmEffects {
 public:
  /// Both must outlive it.
  FarmRecords(Resources* resources, Cleanup* cleanup) : resources_(resources), cleanup_(cleanup) {}
  /// Before any other call.
  void Connect(FarmState* state, Committer* committer, JobChanges* changes) {
    state_ = state;
    committer_ = committer;
    changes_ = changes;
  }

  void RecordEnd(const job::JobId& job, v1::JobState state, const std::string& error) override;
  void CancelFinishing(const job::JobId& job) override;
  void DiscardUnits(const FrameKey& frame, const std::vector<job::UnitKey>& units) override;
  void RecordBlock(const std::string& name, const std::string& reason) override;
  void SkipFrame(const FrameKey& frame, const std::string& cause) override;
  void KeepPrerequisites(const std::set<job::JobId>& jobs) override;
  void WakeHousekeeping() override { housekeeping_.Notify(); }
  void WakeFinisher() override { finishing_.Notify(); }

  threads::Event& housekeeping() { return housekeeping_; }
  threads::Event& finishing() { return finishing_; }
  /// Answers cancellations that wait for the end of the job.
  void AnswerCancels(const job::JobId& job, const absl::StatusOr<v1::JobStatus>& answer);

 private:
  /// Records which frame has failed the job that is ending, if one has.
  absl::Status WriteFailedFrame(const job::JobId& job);
  /// The call of its webhook that is recorded with the job's end.
  std::optional<ledger::NewDelivery> WebhookOf(const job::JobId& job);
  absl::Status WriteEnd(const job::JobId& job, v1::JobState state, const std::string& error);
  void OnEndRecorded(const job::JobId& job, const absl::Status& status);

  Resources* const resources_;
  Cleanup* const cleanup_;
  FarmState* state_ = nullptr;
  Committer* committer_ = nullptr;
  JobChanges* changes_ = nullptr;
  threads::Event housekeeping_;
  threads::Event finishing_;
};

}  // namespace lumifold::server
