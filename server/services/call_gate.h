#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "server/access/audit_log.h"
#include "server/access/identity.h"
#include "server/access/open_calls.h"
#include "server/access/rate_limit.h"
#include "server/services/call_limits.h"
#include "server/services/stall_clock.h"

namespace grpc {
class CallbackServerContext;
}  // namespace grpc

namespace lumifold::server {

/// What every call passes at its start: who calls, whether it may, and whether it calls too often. Calls that
/// change something, and those that are refused, get a line in the audit log at their end.
/// Threads: safe.
class CallGate {
 public:
  struct Options {
    const access::Callers* callers = nullptr;
    access::OpenCalls* open_calls = nullptr;
    access::AuditLog* audit = nullptr;  // null: none
    CallLimits limits;
    /// Of leases: a worker with longer pauses between its heartbeats has not stalled.
    absl::Duration lease = absl::ZeroDuration();
    /// Monotonic, and that of the wall.
    std::function<absl::Time()> now;
    std::function<absl::Time()> wall_now;
    /// For callers whose calls are refused again and again: a refused call costs nearly as much as one that
    /// is answered. `peer` as in grpc::ServerContext. Null: nothing.
    std::function<void(absl::string_view peer)> shut_out = nullptr;
    /// Of each call that is admitted. Null: nothing.
    std::function<void(absl::string_view peer)> admitted = nullptr;
  };

  /// A call that was admitted, until its destruction.
  class Call {
   public:
    Call(CallGate* gate, access::AuditEvent event, bool changes);
    Call(const Call&) = delete;
    Call& operator=(const Call&) = delete;
    /// A call that was not ended has OK as its outcome.
    ~Call();

    const access::Identity& caller() const { return event_.caller; }
    /// As rpc::SentTraceParent.
    const std::string& trace_parent() const { return event_.trace_parent; }
    /// What the limits of this caller are counted by.
    const std::string& limit_key() const { return limit_key_; }
    /// The job, worker, asset or person that the call is about, for the audit log.
    void SetSubject(const std::string& subject) { event_.subject = subject; }
    /// The first outcome counts.
    void End(const absl::Status& outcome);

    // Of a stream:
    /// What ends it early, in place of a cancellation: when its caller loses its identity, or with
    /// kDeadlineExceeded when it has stalled. `end` is called at most once, from another thread, before the
    /// call's destruction.
    void SetEnd(access::OpenCalls::End end);
    /// It is the turn of the other end: to send a message, or to take one. If nothing comes for
    /// Limits::stalled_stream, the stream has stalled. One thread at a time calls these three.
    void AwaitPeer();
    /// It is no longer: a message has come or gone, which is progress whatever its size.
    void PeerMoved();
    /// The same for `bytes` of a file, of which Limits::stalled_file_bytes are progress.
    void PeerMoved(uint64_t bytes);

   private:
    friend class CallGate;
    void Audit(const absl::Status& outcome, bool refused);

    CallGate* const gate_;
    access::AuditEvent event_;
    const bool changes_;
    std::string limit_key_;
    std::optional<std::string> stream_key_;
    std::optional<uint64_t> open_call_;
    std::optional<StallClock> stall_;  // of a stream
    bool ended_ = false;
  };

  /// All that the options name must outlive it.
  explicit CallGate(const Options& options);

  /// A call that is open to everyone needs no identity: the caller then has no name and no scopes.
  /// Errors: kUnauthenticated; kPermissionDenied; kUnavailable for too many requests, and of streams
  /// kResourceExhausted, both naming the limit and its value.
  absl::StatusOr<std::unique_ptr<Call>> Admit(const grpc::CallbackServerContext& context,
                                              absl::string_view rpc_path, const std::string& subject);
  /// The same for a stream, which counts as open until its destruction, and whose `context` is cancelled when
  /// the caller's token or certificate is revoked or expires. The Call must be destroyed in the reactor's
  /// OnDone.
  absl::StatusOr<std::unique_ptr<Call>> AdmitStream(grpc::CallbackServerContext* context,
                                                    absl::string_view rpc_path, const std::string& subject);

  /// Ends the streams that have stalled. To be called every second or so. Returns how many.
  size_t EndStalledStreams();

  /// Audits a call that was refused before it reached a service; its address is not known.
  void NoteRefusal(const access::Identity& caller, absl::string_view rpc_path, const absl::Status& why);

 private:
  /// Ends a call that is not admitted; returns `why`.
  absl::Status Refuse(Call* call, absl::Status why);
  absl::Status Check(const Call& call, absl::string_view rpc_path);
  absl::Status CheckRate(const Call& call);
  absl::Status OpenStream(grpc::CallbackServerContext* context, Call* call);

  const Options options_;
  access::TokenBuckets requests_;
  access::TokenBuckets worker_requests_;
  access::TokenBuckets audited_refusals_;
  access::TokenBuckets refusals_;
  access::CallerCounts streams_;
};

}  // namespace lumifold::server
