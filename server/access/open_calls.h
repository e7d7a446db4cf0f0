#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <thread>

#include "absl/base/thread_annotations.h"
#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "server/access/identity.h"

namespace lumifold::access {

/// Calls that run for long, so that they end when their caller's token or certificate is revoked or expires,
/// or when their other end does nothing.
/// Threads: safe.
class OpenCalls {
 public:
  using End = std::function<void(const absl::Status& why)>;

  /// Registers a call. `end` is called at most once, from another thread, between Add and the end of Remove.
  /// It may call Remove.
  uint64_t Add(const Identity& caller, End end);
  /// Replaces what ends a call that has not been ended.
  void SetEnd(uint64_t call, End end);
  /// The other end must do the next step of the call by `deadline`; InfiniteFuture: it is not its turn.
  void SetDeadline(uint64_t call, absl::Time deadline);
  /// Forgets a call, and waits for its `end` if that runs on another thread.
  void Remove(uint64_t call);

  /// Ends the calls whose caller `check` returns an error for, with that error. `check` must not use this
  /// object. Returns how many.
  size_t EndUnless(absl::FunctionRef<absl::Status(const Identity& caller)> check);

  /// Ends the calls whose deadline is over at `now`, with `why`. Returns how many.
  size_t EndOverdue(absl::Time now, const absl::Status& why);

  size_t size() const;
  /// Calls that have a deadline.
  size_t waiting() const;

 private:
  struct Call {
    Identity caller;
    End end;
    absl::Time deadline = absl::InfiniteFuture();
    std::thread::id ending;  // the thread that runs `end`; none before and after
    bool ended = false;
  };

  /// Ends the calls for which `why` returns an error.
  size_t EndThose(absl::FunctionRef<absl::Status(const Call& call)> why);

  mutable absl::Mutex mutex_;
  uint64_t next_ ABSL_GUARDED_BY(mutex_) = 1;
  std::map<uint64_t, Call> calls_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace lumifold::access
