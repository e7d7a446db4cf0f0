#include "worker/connection/route.h"

#include <algorithm>

namespace lumifold::worker {

absl::Duration Route::Leave(bool was_steady) {
  if (was_steady) {
    schedule_.Reset();
    tried_ = 0;
  }
  if (!sent_to_.empty()) {
    sent_to_.clear();
    tried_ = 0;
    // It may be sent there again and again.
    return was_steady ? absl::ZeroDuration() : schedule_.Next();
  }
  index_ = (index_ + 1) % endpoints_.size();
  if (++tried_ < endpoints_.size()) return absl::ZeroDuration();
  tried_ = 0;
  return schedule_.Next();
}

void Route::MoveTo(std::string address) {
  tried_ = 0;
  const auto found = std::find(endpoints_.begin(), endpoints_.end(), address);
  if (found == endpoints_.end()) {
    sent_to_ = std::move(address);
    return;
  }
  index_ = static_cast<size_t>(found - endpoints_.begin());
  sent_to_.clear();
}

}  // namespace lumifold::worker
