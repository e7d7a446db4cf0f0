#include "server/coordinator/housekeeping.h"

#include <algorithm>

namespace lumifold::server {
namespace {

/// Maximum time between two checks of the leases: options.now may not be the clock that waits use.
constexpr absl::Duration kCheckInterval = absl::Seconds(1);

}  // namespace

void Housekeeping::Start() {
  thread_ = std::thread([this] { Run(); });
}

void Housekeeping::Join() {
  if (thread_.joinable()) thread_.join();
}

void Housekeeping::Run() {
  while (true) {
    cleanup_->janitor().Poke();
    const uint64_t free_bytes = resources_->folder.FreeBytes().value_or(0);
    {
      FarmState::Change farm(state_);
      if (farm->is_stopping()) return;
      farm->LimitFrames(free_bytes);
      const absl::Time now = resources_->options.now();
      farm->ReportLate(farm->scheduler.ExpireLeases(now));
      farm->watchers.Notify(now, [&](const job::JobId& job) { return farm->StatusOf(job); });
    }
    const absl::Duration pause = UntilNext();
    if (pause > absl::ZeroDuration()) wake_up_->Consume(pause);
  }
}

absl::Duration Housekeeping::UntilNext() const {
  FarmState::View farm(state_);
  const absl::Time next = std::min(farm->scheduler.NextExpiry(), farm->watchers.due());
  return std::min(kCheckInterval, next - resources_->options.now());
}

}  // namespace lumifold::server
