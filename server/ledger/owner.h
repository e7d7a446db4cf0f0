#pragma once

#include <cstdint>
#include <string>

#include "server/job/ids.h"

namespace lumifold::ledger {

/// One run of a coordinator. Later runs over the same store have higher epochs; 0 is the owner of none.
using Epoch = job::StrongId<struct EpochTag, int64_t>;

/// A coordinator that jobs belong to.
struct Owner {
  /// Host, process and a random number, for people.
  std::string name;
  Epoch epoch;

  friend bool operator==(const Owner&, const Owner&) = default;
};

/// A job, and the epoch in which the caller owns it.
struct OwnedJob {
  job::JobId job;
  Epoch epoch;
};

/// An attempt is its epoch and, in the lower bits, the number of the lease within the epoch. 2^40 leases last
/// 17 years at 2000 leases/s; 2^23 epochs are left for restarts. With 32 bits an epoch would be full after 25
/// days.
inline constexpr int kAttemptBits = 40;

/// The first attempt of an epoch, for SchedulerOptions::first_attempt: above those of all earlier epochs.
inline job::Attempt FirstAttempt(Epoch epoch) { return job::Attempt(epoch.value() << kAttemptBits); }

inline Epoch EpochOf(job::Attempt attempt) { return Epoch(attempt.value() >> kAttemptBits); }

}  // namespace lumifold::ledger
