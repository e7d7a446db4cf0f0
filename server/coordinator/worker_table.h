#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>

#include "absl/time/time.h"
#include "lumifold/v1/worker.pb.h"
#include "server/coordinator/roles.h"
#include "server/job/ids.h"
#include "server/job/unit.h"

namespace lumifold::server {

struct ConnectedWorker {
  /// Of its certificate, so that a block holds for all processes that have it; without access control as
  /// `process`.
  std::string name = {};
  /// What the worker calls itself.
  std::string process = {};
  std::string caller = {};  // access::KeyOf
  int slots = 0;
  WorkerSink* sink = nullptr;
  absl::Time connected = {};             // by the wall clock, for display
  std::set<job::JobId> known_jobs = {};  // jobs of which the worker got leases
};

/// Who may err by itself, see scheduler::Evidence: the worker's certificate, or the machine that its name has
/// before ":PROCESS".
std::string PartyOf(const std::string& name, bool is_certified);

/// The connected workers, and the way to them. Pure state, apart from the queues of the sinks.
/// Threads: one at a time.
class WorkerTable {
 public:
  /// Returns a new id.
  job::WorkerId Add(ConnectedWorker worker);
  void Remove(job::WorkerId worker) { workers_.erase(worker); }
  ConnectedWorker* Find(job::WorkerId worker);
  const ConnectedWorker* Find(job::WorkerId worker) const;
  const std::map<job::WorkerId, ConnectedWorker>& connected() const { return workers_; }

  /// Id and name, as logs and lists show a worker; the id alone if it is not connected.
  std::string NameOf(job::WorkerId worker) const;

  // These have no effect for a worker that is not connected.
  void Send(job::WorkerId worker, const v1::CoordinatorMessage& message) const;
  void Acknowledge(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                   const std::string& refused = "") const;
  /// Tells those that have leases of the job.
  void SendJobEnded(const job::JobId& job);

 private:
  int64_t next_worker_ = 1;
  std::map<job::WorkerId, ConnectedWorker> workers_;
};

}  // namespace lumifold::server
