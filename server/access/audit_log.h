#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "server/access/identity.h"

namespace lumifold::access {

/// One line of the audit log. It has no secret: neither codes nor tokens are part of a call's name or its
/// error.
struct AuditEvent {
  Identity caller;
  /// "ipv4:192.0.2.1:50000"; empty where it is not known: of a call that was refused before it began.
  std::string address;
  /// "/lumifold.v1.FarmService/CancelJob"
  std::string rpc_path;
  /// The job, worker, asset or person that the call is about; text of the caller.
  std::string subject;
  /// As rpc::SentTraceParent: the caller's, or empty.
  std::string trace_parent = {};
  absl::Status outcome;
};

struct AuditLogOptions {
  std::string path;
  /// A file that reaches this size becomes PATH.1, and the one before it PATH.2, up to PATH.`kept_files`; the
  /// last one is deleted.
  uint64_t max_file_bytes = uint64_t{64} << 20;
  int kept_files = 8;
  /// Bytes that wait for the disk. Further lines are dropped and counted in a line of their own.
  size_t max_waiting_bytes = size_t{4} << 20;
};

/// The append-only record of who did what. A thread of its own writes it, so that a disk that hangs delays no
/// call.
/// Threads: safe.
class AuditLog {
 public:
  /// Opens the file, mode 0600, or creates it. Errors: kUnavailable naming it.
  static absl::StatusOr<std::unique_ptr<AuditLog>> Open(const AuditLogOptions& options);
  /// Waits up to a second for the lines that wait.
  virtual ~AuditLog() = default;

  /// `time` is that of the wall clock. Never blocks.
  virtual void Write(absl::Time time, const AuditEvent& event) = 0;
};

/// The line, without its end.
std::string AuditLine(absl::Time time, const AuditEvent& event);

}  // namespace lumifold::access
