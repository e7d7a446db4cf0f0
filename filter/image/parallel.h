#pragma once

#include <cstdint>
#include <memory>

#include "absl/functional/function_ref.h"

namespace lumifold {

/// Runs independent tasks. Results must not depend on the thread or the order of a task; tests check this
/// with pools that shuffle.
class TaskPool {
 public:
  virtual ~TaskPool() = default;

  /// Calls task(i) once for each i in [0, count), possibly in parallel, and returns when all have ended.
  /// Tasks must not throw.
  virtual void Run(int64_t count, absl::FunctionRef<void(int64_t)> task) = 0;

  /// The most tasks that run in parallel; a hint for splitting work, which no result may depend on.
  virtual int Width() const = 0;
};

/// A pool that runs up to `threads` (>= 1) tasks in parallel, one of them on the caller's thread. Two pools
/// do not wait for each other.
std::unique_ptr<TaskPool> MakeTaskPool(int threads);

/// Runs task(i) for each i in [0, count) on `pool`, or in order on this thread if `pool` is null.
void ParallelFor(TaskPool* pool, int64_t count, absl::FunctionRef<void(int64_t)> task);

}  // namespace lumifold
