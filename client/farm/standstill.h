#pragma once

#include <set>
#include <string>
#include <vector>

#include "absl/time/time.h"
#include "lumifold/v1/farm.pb.h"
#include "lumifold/v1/job.pb.h"

namespace lumifold::client {

/// When to ask why a job does not get on, and what of the answer is new to the user. Pure state.
/// Threads: one at a time.
class Standstill {
 public:
  /// A status of the job has come.
  void Note(const v1::JobStatus& job, absl::Time now);
  /// Whether nothing of it has changed for some seconds, and nobody was asked lately; the caller asks now.
  bool IsTimeToAsk(absl::Time now);
  /// The reasons that were not given yet, but for those that its progress shows, such as a filter at work.
  std::vector<std::string> NewReasons(const v1::ExplainJobResponse& answer);

 private:
  v1::JobState state_ = v1::JOB_STATE_UNSPECIFIED;
  int64_t samples_ = -1;
  absl::Time next_ = absl::InfiniteFuture();  // when to ask
  std::set<std::string> given_;               // codes
};

}  // namespace lumifold::client
