#include "server/access/open_calls.h"

#include <algorithm>
#include <utility>
#include <vector>

namespace lumifold::access {

uint64_t OpenCalls::Add(const Identity& caller, End end) {
  absl::MutexLock lock(&mutex_);
  Call& call = calls_[next_];
  call.caller = caller;
  call.end = std::move(end);
  return next_++;
}

void OpenCalls::SetEnd(uint64_t call, End end) {
  absl::MutexLock lock(&mutex_);
  Call& found = calls_.at(call);
  if (!found.ended) found.end = std::move(end);
}

void OpenCalls::SetDeadline(uint64_t call, absl::Time deadline) {
  absl::MutexLock lock(&mutex_);
  calls_.at(call).deadline = deadline;
}

void OpenCalls::Remove(uint64_t call) {
  const auto may_go = [this, call] {
    mutex_.AssertReaderHeld();
    const auto found = calls_.find(call);
    return found == calls_.end() || found->second.ending == std::thread::id() ||
           found->second.ending == std::this_thread::get_id();
  };
  absl::MutexLock lock(&mutex_);
  mutex_.Await(absl::Condition(&may_go));
  calls_.erase(call);
}

size_t OpenCalls::EndUnless(absl::FunctionRef<absl::Status(const Identity&)> check) {
  return EndThose([&check](const Call& call) { return check(call.caller); });
}

size_t OpenCalls::EndOverdue(absl::Time now, const absl::Status& why) {
  return EndThose([&](const Call& call) { return call.deadline <= now ? why : absl::OkStatus(); });
}

size_t OpenCalls::EndThose(absl::FunctionRef<absl::Status(const Call&)> why) {
  struct Ending {
    uint64_t call;
    End end;
    absl::Status why;
  };
  std::vector<Ending> endings;
  {
    absl::MutexLock lock(&mutex_);
    for (auto& [number, call] : calls_) {
      if (call.ended) continue;
      absl::Status status = why(call);
      if (status.ok()) continue;
      call.ended = true;
      call.ending = std::this_thread::get_id();
      endings.push_back({number, std::move(call.end), std::move(status)});
    }
  }
  // Without the lock: ending a call may run its OnDone on this thread, which removes it.
  for (const Ending& ending : endings) {
    ending.end(ending.why);
    absl::MutexLock lock(&mutex_);
    if (const auto found = calls_.find(ending.call); found != calls_.end()) found->second.ending = {};
  }
  return endings.size();
}

size_t OpenCalls::waiting() const {
  absl::MutexLock lock(&mutex_);
  return static_cast<size_t>(std::count_if(calls_.begin(), calls_.end(), [](const auto& entry) {
    return entry.second.deadline != absl::InfiniteFuture();
  }));
}

size_t OpenCalls::size() const {
  absl::MutexLock lock(&mutex_);
  return calls_.size();
}

}  // namespace lumifold::access
