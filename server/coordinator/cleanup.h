#pragma once

#include <atomic>
#include <string>

#include "proto/threads/task_thread.h"
#include "server/coordinator/resources.h"
#include "server/storage/janitor.h"

namespace lumifold::server {

/// Removes what is no longer needed, on threads for which nobody waits: files, rows of units, and what the
/// janitor finds.
/// Threads: safe.
class Cleanup {
 public:
  /// `resources` must outlive it.
  explicit Cleanup(const Resources* resources);

  Janitor& janitor() { return janitor_; }
  /// Deletes a file or folder, at low priority.
  void DeleteFiles(const std::string& path);
  /// Deletes rows of units that are not needed any more, some at a time.
  void PurgeUnits();
  void Stop();

 private:
  const Resources* const resources_;
  std::atomic<bool> purging_{false};
  threads::TaskThread deleter_{threads::TaskThread::Priority::kLowest};  // of files
  threads::TaskThread purger_{threads::TaskThread::Priority::kNormal};   // of rows
  Janitor janitor_;
};

}  // namespace lumifold::server
