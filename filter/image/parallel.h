#pragma once

#include <cstdint>
#include <memory>

#include "absl/functional/function_ref.h"

namespace lumifold {

/// Runs independent tasks. Results must not depend on who runs which task or in what order; tests prove it
/// with pools that shuffle.
class TaskPool {
 public:
  virtual ~TaskPool() = default;

  /// Calls task(i) once for each i in [0, count), perhaps side by side, and returns when all have ended.
  /// Tasks must not throw.
  virtual void Run(int64_t count, absl::FunctionRef<void(int64_t)> task) = 0;

  /// How many tasks may run at the same time; a hint for splitting work, never a value results may depend on.
  virtual int Width() const = 0;
};

/// A pool that runs up to `threads` (>= 1) tasks at a time, the caller's thread among them. Two pools do not
/// wait for each other.
std::unique_ptr<TaskPool> MakeTaskPool(int threads);

/// Runs task(i) for each i in [0, count) on `pool`, or one after another on this thread where pool is null.
void ParallelFor(TaskPool* pool, int64_t count, absl::FunctionRef<void(int64_t)> task);

}  // namespace lumifold
