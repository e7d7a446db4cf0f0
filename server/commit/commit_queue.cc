#include "server/commit/commit_queue.h"

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <utility>

namespace lumifold::server {
namespace {

/// Maximum time between two looks at the clock: the committer's may not be the clock that waits use.
constexpr absl::Duration kLongestLook = absl::Seconds(1);

}  // namespace

void CommitQueue::Add(AcceptedUnit unit) {
  absl::MutexLock lock(&mutex_);
  if (!stopping_) units_.push_back(std::move(unit));
}

void CommitQueue::Add(Order order) {
  {
    absl::MutexLock lock(&mutex_);
    if (!stopping_) orders_.push_back(std::move(order));
    has_new_order_ = true;
  }
  wake_up_.Notify();
}

void CommitQueue::NoteStorageFailure() {
  absl::MutexLock lock(&mutex_);
  storage_failed_ = true;
}

void CommitQueue::Stop() {
  {
    absl::MutexLock lock(&mutex_);
    stopping_ = true;
  }
  wake_up_.Notify();
}

bool CommitQueue::is_stopping() const {
  absl::MutexLock lock(&mutex_);
  return stopping_;
}

CommitQueue::Work CommitQueue::Await() {
  absl::MutexLock lock(&mutex_);
  mutex_.Await(absl::Condition(this, &CommitQueue::HasWork));
  if (stopping_ && orders_.empty() && units_.empty()) return Work::kEnded;
  return std::exchange(storage_failed_, false) ? Work::kStorageFailed : Work::kWaits;
}

bool CommitQueue::EndsPause() const {
  absl::MutexLock lock(&mutex_);
  return stopping_ || has_new_order_;
}

void CommitQueue::Pause(absl::Time end, const std::function<absl::Time()>& now) {
  for (absl::Time time = now(); time < end && !EndsPause(); time = now())
    wake_up_.Consume(std::min(end - time, kLongestLook));
}

std::optional<CommitQueue::Order> CommitQueue::FirstOrder() {
  absl::MutexLock lock(&mutex_);
  has_new_order_ = false;
  if (orders_.empty()) return std::nullopt;
  return orders_.front();
}

void CommitQueue::PopOrder() {
  absl::MutexLock lock(&mutex_);
  orders_.pop_front();
}

std::vector<AcceptedUnit> CommitQueue::TakeUnits(size_t count) {
  absl::MutexLock lock(&mutex_);
  const auto end = units_.begin() + static_cast<std::ptrdiff_t>(std::min(units_.size(), count));
  std::vector<AcceptedUnit> taken(std::make_move_iterator(units_.begin()), std::make_move_iterator(end));
  units_.erase(units_.begin(), end);
  return taken;
}

void CommitQueue::DropUnits(const job::JobId& job) {
  absl::MutexLock lock(&mutex_);
  std::erase_if(units_, [&job](const AcceptedUnit& unit) { return unit.stored.unit.job == job; });
}

}  // namespace lumifold::server
