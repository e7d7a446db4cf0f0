#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"

namespace spdlog {
class logger;
}  // namespace spdlog

namespace lumifold::server {

/// Whether an error is one of the storage (a full or read-only disk, no descriptors, a database that does not
/// answer or is malformed), not of the job for which it was noticed. It may go away, and what failed is tried
/// again.
bool IsStorageError(const absl::Status& status);

/// Whether the coordinator can write to its storage, why not, and since when. While it cannot, no lease is
/// granted and no job or upload is accepted, but everything that can be read is served. The committer tries
/// again and ends the outage.
/// Threads: safe. It calls nobody while it holds its lock.
class StorageState {
 public:
  struct Outage {
    std::string error;
    /// See status().
    absl::Status answer;
    /// Wall clock, for display.
    absl::Time since;
  };

  /// `wall_now` stamps outages. `log` is told once when an outage begins and once when it ends.
  StorageState(std::function<absl::Time()> wall_now, std::shared_ptr<spdlog::logger> log);

  /// OK, or retry::StorageAway of what began the outage.
  absl::Status status() const;
  bool ok() const { return !outage().has_value(); }
  std::optional<Outage> outage() const;

  /// An operation failed with a storage error; then calls the function that was set. The outage has the first
  /// cause.
  void Fail(const absl::Status& cause);
  /// Writing works again.
  void Recover();

  /// Sets what is called with false when an outage begins and with true when it ends. Call it before any
  /// other thread has the object.
  void OnChange(std::function<void(bool)> callback) { on_change_ = std::move(callback); }
  /// Sets what Fail calls. Call it before any other thread has the object.
  void OnFail(std::function<void()> callback) { on_fail_ = std::move(callback); }

 private:
  const std::function<absl::Time()> wall_now_;
  const std::shared_ptr<spdlog::logger> log_;
  std::function<void(bool)> on_change_ = [](bool) {};
  std::function<void()> on_fail_ = [] {};
  mutable absl::Mutex mutex_;
  std::optional<Outage> outage_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace lumifold::server
