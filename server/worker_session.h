#pragma once

#include <map>
#include <memory>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "lumifold/v1/worker.pb.h"
#include "server/coordinator_impl.h"
#include "server/film/unit_assembler.h"

namespace lumifold::server {

/// One worker's connection: puts its units together from chunks and hands them to the coordinator. What it
/// holds is bounded by the leases the worker has; chunks of anything else are dropped. When it is destroyed
/// the worker's leases are void.
/// Threads: one at a time.
class WorkerSession {
 public:
  /// `coordinator` and `sink` must outlive it.
  /// Errors: kFailedPrecondition for another wire version; kInvalidArgument for a bad Hello.
  static absl::StatusOr<std::unique_ptr<WorkerSession>> Open(Coordinator* coordinator, const v1::Hello& hello,
                                                             WorkerSink* sink);
  ~WorkerSession();
  WorkerSession(const WorkerSession&) = delete;
  WorkerSession& operator=(const WorkerSession&) = delete;

  /// Takes a message after Hello.
  /// Errors: kInvalidArgument for a second Hello or none of the known messages: the stream is to end.
  absl::Status Handle(const v1::WorkerMessage& message);

 private:
  using LeaseName = std::pair<scheduler::UnitRef, scheduler::Attempt>;

  WorkerSession(Coordinator* coordinator, scheduler::WorkerId worker)
      : coordinator_(coordinator), worker_(worker) {}
  void OnHeartbeat(const v1::Heartbeat& heartbeat);
  void OnChunk(const v1::UnitChunk& chunk);
  absl::Status Take(const v1::UnitChunk& chunk, const LeaseName& lease, const Rect& rect);

  Coordinator* const coordinator_;
  const scheduler::WorkerId worker_;
  std::map<LeaseName, film::UnitAssembler> arriving_;
};

}  // namespace lumifold::server
