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
#include "server/access/identity.h"

namespace lumifold::access {

/// Calls that run for long, so that they end when their caller's token or certificate is revoked or expires.
/// Threads: safe.
class OpenCalls {
 public:
  using End = std::function<void(const absl::Status& why)>;

  /// Registers a call. `end` is called at most once, from another thread, between Add and the end of Remove. It may call
  /// Remove.
  uint64_t Add(const Identity& caller, End end);
  /// Forgets a call, and waits for its `end` if that runs on another thread.
  void Remove(uint64_t call);

  /// Ends the calls whose caller `check` returns an error for, with that error. `check` must not use this object.
  /// Returns how many.
  size_t EndUnless(absl::FunctionRef<absl::Status(const Identity& caller)> check);

  size_t size() const;

 private:
  struct Call {
    Identity caller;
    End end;
    std::thread::id ending;  // the thread that runs `end`; none before and after
    bool ended = false;
  };

  mutable absl::Mutex mutex_;
  uint64_t next_ ABSL_GUARDED_BY(mutex_) = 1;
  std::map<uint64_t, Call> calls_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace lumifold::access
