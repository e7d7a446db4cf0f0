#include "server/coordinator/watchers.h"

#include <utility>

namespace lumifold::server {
namespace {

/// Minimum time between two statuses of a job sent to a client.
constexpr absl::Duration kWatchInterval = absl::Milliseconds(100);

}  // namespace

void Watchers::MarkChanged(const job::JobId& job) {
  changed_.insert(job);
  has_news_ = true;
}

bool Watchers::TakeNews() { return std::exchange(has_news_, false); }

absl::Time Watchers::due() const {
  return changed_.empty() ? absl::InfiniteFuture() : notified_ + kWatchInterval;
}

void Watchers::Notify(absl::Time now,
                      absl::FunctionRef<std::optional<v1::JobStatus>(const job::JobId&)> status) {
  if (now < due()) return;
  notified_ = now;
  for (const auto& [watcher, job] : watchers_) {
    if (!changed_.contains(job)) continue;
    if (const std::optional<v1::JobStatus> current = status(job)) watcher->OnStatus(*current);
  }
  changed_.clear();
}

void Watchers::NotifyEnd(const job::JobId& job, const absl::StatusOr<v1::JobStatus>& last) const {
  for (const auto& [watcher, watched] : watchers_) {
    if (watched != job) continue;
    if (last.ok()) {
      watcher->OnStatus(*last);
    } else {
      watcher->OnLost(last.status());
    }
  }
}

}  // namespace lumifold::server
