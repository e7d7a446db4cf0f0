#pragma once

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "lumifold/v1/image.pb.h"
#include "lumifold/v1/job.pb.h"
#include "lumifold/v1/worker.pb.h"

namespace lumifold::worker {

/// The way to the coordinator for frames that the worker finishes.
/// Threads: implementations are safe concurrently.
class FrameLink {
 public:
  virtual ~FrameLink() = default;

  /// Fetches the units of the lease's frame; `take` gets the pieces of v1::WorkerService::FetchUnits.
  /// Errors: that of `take`; kPermissionDenied where the lease is void; kUnavailable and others when the
  /// coordinator cannot be reached.
  virtual absl::Status FetchUnits(const v1::Lease& lease,
                                  absl::FunctionRef<absl::Status(const v1::ByteChunk&)> take) = 0;
  /// Delivers its result; `next` fills the pieces, as rpc::ByteSender::Next. OK: it is committed.
  /// Of `report` its times and the estimated error are told.
  /// Errors: that of `next`; kAborted, kPermissionDenied where the lease is void; others as above.
  virtual absl::Status DeliverResult(const v1::Lease& lease, const v1::FrameReport& report,
                                     absl::FunctionRef<absl::StatusOr<bool>(v1::ByteChunk*)> next) = 0;
};

}  // namespace lumifold::worker
