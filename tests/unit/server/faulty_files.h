#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "filter/image/file_system.h"

namespace lumifold::server {

/// The real files, with faults: any call can fail, and the machine can stop at any call and forget what was
/// not synced. Nothing is really synced, so that tests are fast.
class FaultyFiles final : public FileSystem {
 public:
  /// Call number `call`, from 1, fails once with `error` (errno).
  void FailAt(int64_t call, int error);
  /// The next `count` writes to files with `part` in their path fail with EIO.
  void FailWrites(int count, const std::string& part);
  int failing_writes() const;
  /// The machine stops in call number `call`: half of a write is done, nothing else happens any more.
  void StopAt(int64_t call);
  /// From now on every call that changes a path with `part` in it fails with `error`, until Heal.
  void Fail(int error, const std::string& part = "");
  void Heal() { Fail(0); }
  /// From now on every write and sync of the file that is at `path` now fails with EIO, whatever its name.
  void Break(const std::string& path);

  /// After a stop: undoes everything that was not synced, if `loses_unsynced`, and goes on without faults.
  void Restart(bool loses_unsynced);
  bool has_stopped() const;
  int64_t calls() const;
  /// Called before each call, with its path.
  void OnCall(std::function<void(const std::string&)> callback) { on_call_ = std::move(callback); }

  int Open(const std::string& path, int flags) override;
  int Write(int file, uint64_t offset, absl::Span<const std::string_view> pieces) override;
  int Truncate(int file, uint64_t size) override;
  int Allocate(int file, uint64_t size) override;
  int Sync(int file) override;
  int SyncFolder(const std::string& folder) override;
  int Rename(const std::string& from, const std::string& to) override;
  int Remove(const std::string& path) override;
  int MakeFolder(const std::string& path) override;

 private:
  /// What a path was when it was last durable.
  struct Durable {
    std::string path;
    std::optional<std::string> content;  // nullopt: it did not exist, or is a folder
    bool is_folder = false;              // it was a folder
  };

  bool IsBroken(int file) const;
  bool FailsThisWrite(const std::string& path);
  /// 0, or the error with which the call fails.
  int Begin(const std::string& path);
  std::string PathOf(int file) const;
  /// Remembers the durable content of a file that is about to change.
  void KeepContent(const std::string& path);
  void KeepName(const std::string& path);

  FileSystem* const real_ = RealFileSystem();
  std::function<void(const std::string&)> on_call_ = [](const std::string&) {};
  mutable absl::Mutex mutex_;
  int64_t calls_ ABSL_GUARDED_BY(mutex_) = 0;
  int64_t fail_at_ ABSL_GUARDED_BY(mutex_) = 0;
  int fail_error_ ABSL_GUARDED_BY(mutex_) = 0;
  int64_t stop_at_ ABSL_GUARDED_BY(mutex_) = 0;
  bool stops_now_ ABSL_GUARDED_BY(mutex_) = false;
  bool stopped_ ABSL_GUARDED_BY(mutex_) = false;
  int failing_ ABSL_GUARDED_BY(mutex_) = 0;
  int failing_writes_ ABSL_GUARDED_BY(mutex_) = 0;
  std::string failing_writes_part_ ABSL_GUARDED_BY(mutex_);
  std::string failing_part_ ABSL_GUARDED_BY(mutex_);
  std::optional<uint64_t> broken_ ABSL_GUARDED_BY(mutex_);  // inode
  std::map<int, std::string> open_ ABSL_GUARDED_BY(mutex_);
  std::map<std::string, std::string> contents_ ABSL_GUARDED_BY(mutex_);  // durable ones of changed files
  std::vector<Durable> names_ ABSL_GUARDED_BY(mutex_);                   // oldest first
};

}  // namespace lumifold::server
