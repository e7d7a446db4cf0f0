#pragma once

#include <atomic>
#include <functional>
#include <string>
#include <vector>

#include "proto/threads/event.h"
#include "proto/threads/task_thread.h"
#include "server/cluster/membership.h"
#include "server/coordinator/cleanup.h"
#include "server/coordinator/farm_state.h"
#include "server/coordinator/job_loader.h"
#include "server/coordinator/operator_calls.h"
#include "server/coordinator/resources.h"
#include "server/coordinator/submission.h"

namespace lumifold::server {

/// What a coordinator does as one of several over the same ledger and data folder: it adopts jobs, sends
/// workers where they are needed, and looks at what the others have changed.
/// Threads: safe; it has one of its own.
class Takeover final : public cluster::MemberHost {
 public:
  struct Parts {
    JobLoader* loader;
    Submission* submission;
    OperatorCalls* operators;
    /// Ends leasing here.
    std::function<void()> stop_leasing;
  };
  /// All must outlive it.
  Takeover(Resources* resources, FarmState* state, Parts parts)
      : resources_(resources), state_(state), parts_(std::move(parts)) {}

  void SetMetrics(ledger::Member* member) override;
  void Adopt(const std::vector<ledger::AdoptedJob>& jobs) override;
  void MoveWorkers(const cluster::WorkerMove& move) override;
  void SendWorkersAway(const std::string& address) override;
  void OnExpelled() override;
  void LookAtOthers() override;

  /// Once the farm is stopping.
  void Stop();

 private:
  // All on the thread.
  /// Makes a job that is this coordinator's in the ledger one in memory. Waits for the storage.
  void AdoptJob(const job::JobId& job);
  absl::Status TryToAdopt(const job::JobId& job);
  /// Assets that jobs wait for and others have stored.
  void FindStoredAssets();

  Resources* const resources_;
  FarmState* const state_;
  const Parts parts_;
  std::atomic<bool> is_looking_{false};
  threads::Event stopping_;
  threads::TaskThread thread_{threads::TaskThread::Priority::kNormal};  // last: its tasks use the others
};

}  // namespace lumifold::server
