#pragma once

#include <sys/types.h>

#include <cstddef>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "proto/rpc/byte_stream.h"

namespace lumifold::subprocess {

/// What a standard stream of a child is.
enum class Stream {
  kInherited,      // that of this process
  kNothing,        // /dev/null
  kPipe,           // of out and err: what Child::ReadOutput reads
  kStandardError,  // of out: this process's standard error
  kFile,           // of in: ChildOptions::in_file
};

struct ChildOptions {
  /// The program, looked for on PATH unless it has a slash, and its arguments.
  std::vector<std::string> words;
  /// Changes of this process's environment: "NAME=VALUE" sets a variable, "NAME" takes it out, and "NAME*"
  /// all that begin so.
  std::vector<std::string> environment = {};
  Stream in = Stream::kInherited;
  int in_file = -1;  // a descriptor
  Stream out = Stream::kInherited;
  Stream err = Stream::kInherited;
  /// A process group of its own, so that Kill reaches the child's children, and Ctrl-C does not reach it.
  bool own_group = false;
};

struct ExitStatus {
  int code = 0;
  int signal = 0;  // that ended it; 0: none

  /// "ended with code 3" or "ended by signal 9".
  std::string Text() const;
};

/// What a child wrote.
struct Output {
  std::string out;
  std::string err;
};

/// A child process, without a shell; no signal is blocked in it.
/// Threads: Kill from any, the others from one at a time.
class Child {
 public:
  /// Errors: kUnavailable where the machine has no process, descriptor or memory left; otherwise kInternal.
  /// Both with the system's message.
  static absl::StatusOr<std::unique_ptr<Child>> Start(const ChildOptions& options);
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;
  /// Kills it unless Wait has returned its status.
  ~Child();

  /// Appends what comes through the pipes until the child, and all who have them from it, have closed them.
  /// `on_news` is called when something has come, and may take it away.
  /// False after `deadline` (rpc::MonotonicNow), or where there is more than `max_bytes`.
  bool ReadOutput(
      absl::Time deadline, size_t max_bytes, Output* output,
      absl::FunctionRef<void(Output*)> on_news = [](Output*) {});
  /// Waits for its end. Call it no more once it has returned the status.
  /// Errors: kDeadlineExceeded after `deadline`; kInternal where the system does not tell.
  absl::StatusOr<ExitStatus> Wait(absl::Time deadline = absl::InfiniteFuture());
  /// SIGKILL; to its group if that is its own. No effect once it has been waited for.
  void Kill() ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  Child(pid_t pid, bool own_group, rpc::FileHandle out, rpc::FileHandle err)
      : pid_(pid), own_group_(own_group), out_(std::move(out)), err_(std::move(err)) {}

  const pid_t pid_;
  const bool own_group_;
  const rpc::FileHandle out_;  // empty without a pipe
  const rpc::FileHandle err_;
  absl::Mutex mutex_;
  bool is_reaped_ ABSL_GUARDED_BY(mutex_) = false;  // its pid may be another process's
};

}  // namespace lumifold::subprocess
