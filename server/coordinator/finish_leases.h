#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/time/time.h"
#include "absl/types/span.h"
#include "server/coordinator/frame_queue.h"
#include "server/job/ids.h"
#include "server/scheduler/types.h"

namespace lumifold::server {

/// What a worker offers for finishing frames, see v1::Hello.
struct FinishOffer {
  std::string party = {};  // see PartyOf
  std::string numeric_class;
  int places = 0;
  uint64_t memory_bytes = 0;
};

/// The right of a worker to finish a frame or a block.
struct FinishLease {
  FramePart part;
  job::WorkerId worker{};
  std::string party = {};  // the worker's, set by Grant
  uint64_t memory_bytes = 0;
  int64_t pixels = 0;
  absl::Time granted = {};
  absl::Time heard = {};  // when the worker last named it
  int64_t progress = 0;
  absl::Time progressed = {};  // when that last changed
  /// Its result has arrived and is being recorded: the lease does not end before that.
  bool is_delivered = false;
};

/// The leases of workers to finish frames. They end as those of units do: with the connection, without
/// heartbeats, when the worker no longer names them, and when they stand still for longer than a lease and
/// the filter of their pixels on a slow machine; and after half an hour, so that whoever only seems to work
/// costs no more. Pure state.
/// Threads: one at a time.
class FinishLeases {
 public:
  /// `lease`: time without a heartbeat after which one expires.
  explicit FinishLeases(absl::Duration lease) : lease_(lease) {}

  /// No effect without places.
  void AddWorker(job::WorkerId worker, const FinishOffer& offer);
  /// Returns the leases that end with it.
  std::vector<job::Attempt> RemoveWorker(job::WorkerId worker);
  /// The worker of this class that has most places left, and this memory, of those that are available.
  std::optional<job::WorkerId> FindPlace(const std::string& numeric_class, uint64_t memory_bytes,
                                         absl::FunctionRef<bool(job::WorkerId)> is_available) const;

  /// `attempt` is new; worker, frame and memory of `lease` are set.
  void Grant(job::Attempt attempt, FinishLease lease, absl::Time now);
  /// Whether a worker of this class offers places and this memory, taken or not, of those that are available.
  bool HasOffer(const std::string& numeric_class, uint64_t memory_bytes,
                absl::FunctionRef<bool(job::WorkerId)> is_available) const;
  /// Null if the worker has no such lease. Valid until the next change.
  FinishLease* Find(job::WorkerId worker, const FramePart& part, job::Attempt attempt);
  /// The lease exists; returns it.
  FinishLease End(job::Attempt attempt);
  bool IsDelivered(job::Attempt attempt) const { return leases_.at(attempt).is_delivered; }
  /// Those of a job.
  std::vector<job::Attempt> OfJob(const job::JobId& job) const;

  /// Renews what `held` names. Returns those that the worker has received, by `newest`, and does not name.
  std::vector<job::Attempt> Heartbeat(job::WorkerId worker, absl::Span<const scheduler::HeldLease> held,
                                      job::Attempt newest, absl::Time now);
  /// A party has failed what it had of a job: it gets nothing of it for 5 minutes, unless half of those that
  /// offer places do not get any already. Otherwise a machine that fails everything at once would have places
  /// for all frames.
  void Exclude(const std::string& party, const job::JobId& job, absl::Time now);
  bool IsExcluded(job::WorkerId worker, const job::JobId& job, absl::Time now) const;
  /// Those that are over, and those of workers that are blocked.
  std::vector<job::Attempt> Expired(absl::Time now, absl::FunctionRef<bool(job::WorkerId)> is_blocked) const;
  int64_t size() const { return static_cast<int64_t>(leases_.size()); }

 private:
  const absl::Duration lease_;
  struct Offer {
    FinishOffer whole;
    FinishOffer left;
  };
  std::map<job::WorkerId, Offer> offers_;
  std::map<job::Attempt, FinishLease> leases_;
  std::map<job::JobId, std::map<std::string, absl::Time>> excluded_;  // party: until when
};

}  // namespace lumifold::server
