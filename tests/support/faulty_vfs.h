#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace lumifold {

/// A file system for SQLite (a VFS) on top of the real one, for tests of what happens when storage fails.
/// While it exists it is SQLite's default. It knows which writes were synced, so that a power cut can be
/// played: the others are lost, or some of them are, the last one half.
/// Threads: one at a time.
class FaultyVfs {
 public:
  enum class Fault { kNone, kNoSpace, kInputOutput, kNoMemory, kPowerCut };
  /// What survives a power cut of the writes that were not synced, in the order in which they were made.
  enum class Survivors { kNone, kFirstHalf, kAllButHalfOfTheLast, kEveryOther };

  FaultyVfs();
  ~FaultyVfs();
  FaultyVfs(const FaultyVfs&) = delete;
  FaultyVfs& operator=(const FaultyVfs&) = delete;

  /// Call number `call` from now on (from 1) fails once; after a power cut all do. kNoSpace and kPowerCut
  /// count only calls that change files, the others all calls.
  void FailAt(int64_t call, Fault fault);
  /// Whether the fault has happened.
  bool has_failed() const { return has_failed_; }
  /// Sets the files to what a power cut leaves of them, and works again. Close all databases before.
  void Restore(Survivors survivors);

  struct Write {
    std::string path;
    int64_t offset = 0;
    std::string bytes;
    bool is_truncation = false;  // to the size `offset`
  };
  /// For the implementation. Whether this call fails.
  bool Fails(bool is_change);
  Fault fault() const { return fault_; }
  void OnOpen(const std::string& path);
  void OnWrite(Write write) { unsynced_.push_back(std::move(write)); }
  void OnSync(const std::string& path);
  void OnDelete(const std::string& path);

 private:
  static void Apply(const Write& write, size_t bytes, std::string* content);

  std::map<std::string, std::string> durable_;  // content by path
  std::vector<Write> unsynced_;
  Fault fault_ = Fault::kNone;
  int64_t calls_left_ = 0;
  bool has_failed_ = false;
};

}  // namespace lumifold
