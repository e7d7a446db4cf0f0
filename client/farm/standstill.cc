#include "client/farm/standstill.h"

#include "absl/strings/match.h"

namespace lumifold::client {
namespace {

constexpr absl::Duration kPatience = absl::Seconds(4);
constexpr absl::Duration kPause = absl::Seconds(15);

}  // namespace

void Standstill::Note(const v1::JobStatus& job, absl::Time now) {
  if (job.state() == state_ && job.samples_done() == samples_) return;
  state_ = job.state();
  samples_ = job.samples_done();
  next_ = now + kPatience;
}

bool Standstill::IsTimeToAsk(absl::Time now) {
  if (now < next_) return false;
  next_ = now + kPause;
  return true;
}

std::vector<std::string> Standstill::NewReasons(const v1::ExplainJobResponse& answer) {
  std::vector<std::string> reasons;
  for (const v1::Reason& reason : answer.reasons()) {
    if (absl::StartsWith(reason.code(), "filter") || !given_.insert(reason.code()).second) continue;
    reasons.push_back(reason.text());
  }
  return reasons;
}

}  // namespace lumifold::client
