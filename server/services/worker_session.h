#pragma once

#include <map>
#include <memory>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "lumifold/v1/worker.pb.h"
#include "server/coordinator/roles.h"
#include "server/film/unit_assembler.h"

namespace lumifold::server {

/// The connection of one worker: joins the chunks of units and passes complete units to the coordinator. It
/// holds chunks of leased units only and drops all others, which bounds its memory. Its destruction voids the
/// worker's leases.
/// Threads: one at a time.
class WorkerSession {
 public:
  /// `workers` and `sink` must outlive it. `caller`: whose connection it is.
  /// Errors: kFailedPrecondition for a different wire version; kInvalidArgument for an invalid Hello.
  static absl::StatusOr<std::unique_ptr<WorkerSession>> Open(WorkerApi* workers, const v1::Hello& hello,
                                                             const access::Identity& caller,
                                                             WorkerSink* sink);
  ~WorkerSession();
  WorkerSession(const WorkerSession&) = delete;
  WorkerSession& operator=(const WorkerSession&) = delete;

  /// Handles a message after Hello. Takes the pixels of a chunk.
  /// Errors: kInvalidArgument for a second Hello or an unknown message; the stream must then be closed.
  absl::Status Handle(v1::WorkerMessage* message);

 private:
  using LeaseName = std::pair<job::UnitRef, job::Attempt>;

  WorkerSession(WorkerApi* workers, job::WorkerId worker) : workers_(workers), worker_(worker) {}
  void OnHeartbeat(const v1::Heartbeat& heartbeat);
  void OnFailure(const v1::UnitFailure& failure);
  void OnChunk(v1::UnitChunk* chunk);
  void OnPlan(v1::DeliveredPlan* delivered);
  void OnKept(const v1::KeptUnit& kept);
  absl::Status Take(v1::UnitChunk* chunk, const LeaseName& lease, const LeasedUnit& leased);

  WorkerApi* const workers_;
  const job::WorkerId worker_;
  std::map<LeaseName, film::UnitAssembler> arriving_;
};

}  // namespace lumifold::server
