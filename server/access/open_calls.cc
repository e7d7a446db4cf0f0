#include "server/access/open_calls.h"

#include <utility>
#include <vector>

namespace lumifold::access {

uint64_t OpenCalls::Add(const Identity& caller, End end) {
  absl::MutexLock lock(&mutex_);
  calls_.emplace(next_, Call{.caller = caller, .end = std::move(end), .ending = {}});
  return next_++;
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
      absl::Status status = check(call.caller);
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

size_t OpenCalls::size() const {
  absl::MutexLock lock(&mutex_);
  return calls_.size();
}

}  // namespace lumifold::access
