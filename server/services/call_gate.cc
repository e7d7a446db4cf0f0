#include "server/services/call_gate.h"

#include <grpcpp/server_context.h>

#include <algorithm>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "proto/rpc/trace_context.h"
#include "server/access/authorisation.h"

namespace lumifold::server {
namespace {

constexpr absl::string_view kWorkerService = "/lumifold.v1.WorkerService/";
/// Refusals of one caller that the audit log takes: a flood must not push out what was there before.
constexpr double kAuditedRefusalsPerSecond = 10;
constexpr double kAuditedRefusalBurst = 100;
/// Refusals by the gate itself before the caller's address is shut out. Clients wait between attempts.
constexpr double kRefusalsPerSecond = 10;
constexpr double kRefusalBurst = 100;

/// "ipv4:192.0.2.1" of "ipv4:192.0.2.1:50000".
absl::string_view WithoutPort(absl::string_view peer) {
  if (!absl::StartsWith(peer, "ipv4:") && !absl::StartsWith(peer, "ipv6:")) return peer;
  return peer.substr(0, peer.rfind(':'));
}

/// Without access control there is one identity: its limits are those of an address. Calls inside the process
/// have none.
std::string LimitKeyOf(const access::Identity& caller, absl::string_view peer) {
  if (caller.name.empty()) return absl::StrCat("nobody/", WithoutPort(peer));
  if (caller.kind != access::IdentityKind::kLocal) return access::KeyOf(caller);
  if (!absl::StartsWith(peer, "ipv") && !absl::StartsWith(peer, "unix:")) return "";
  return absl::StrCat("local/", WithoutPort(peer));
}

}  // namespace

CallGate::Call::Call(CallGate* gate, access::AuditEvent event, bool changes)
    : gate_(gate),
      event_(std::move(event)),
      changes_(changes),
      limit_key_(LimitKeyOf(event_.caller, event_.address)) {}

CallGate::Call::~Call() {
  if (open_call_.has_value()) gate_->options_.open_calls->Remove(*open_call_);
  if (stream_key_.has_value()) gate_->streams_.Remove(*stream_key_);
  End(absl::OkStatus());
}

void CallGate::Call::End(const absl::Status& outcome) {
  // A stream that the other side broke did what it did; other errors of calls that change nothing are of no
  // interest.
  Audit(outcome, absl::IsPermissionDenied(outcome) || absl::IsUnauthenticated(outcome) ||
                     absl::IsResourceExhausted(outcome) || absl::IsNotFound(outcome));
}

void CallGate::Call::Audit(const absl::Status& outcome, bool refused) {
  if (std::exchange(ended_, true) || gate_->options_.audit == nullptr) return;
  if (!changes_ && !refused) return;
  if (refused && !gate_->audited_refusals_.Take(limit_key_, gate_->options_.now())) return;
  event_.outcome = outcome;
  gate_->options_.audit->Write(gate_->options_.wall_now(), event_);
}

void CallGate::Call::SetEnd(access::OpenCalls::End end) {
  gate_->options_.open_calls->SetEnd(*open_call_, std::move(end));
}

void CallGate::Call::AwaitPeer() {
  gate_->options_.open_calls->SetDeadline(*open_call_, stall_->Await(gate_->options_.now()));
}

void CallGate::Call::PeerMoved() {
  stall_->Restart();
  gate_->options_.open_calls->SetDeadline(*open_call_, absl::InfiniteFuture());
}

void CallGate::Call::PeerMoved(uint64_t bytes) {
  stall_->Move(gate_->options_.now(), bytes);
  gate_->options_.open_calls->SetDeadline(*open_call_, absl::InfiniteFuture());
}

CallGate::CallGate(const Options& options)
    : options_(options),
      requests_(options.limits.requests_per_second, options.limits.request_burst),
      worker_requests_(options.limits.worker_requests_per_second, options.limits.worker_request_burst),
      audited_refusals_(kAuditedRefusalsPerSecond, kAuditedRefusalBurst),
      refusals_(kRefusalsPerSecond, kRefusalBurst) {}

absl::Status CallGate::Refuse(Call* call, absl::Status why) {
  call->Audit(why, /*refused=*/true);
  if (options_.shut_out != nullptr && !refusals_.Take(call->limit_key(), options_.now()))
    options_.shut_out(call->event_.address);
  return why;
}

absl::StatusOr<std::unique_ptr<CallGate::Call>> CallGate::Admit(const grpc::CallbackServerContext& context,
                                                                absl::string_view rpc_path,
                                                                const std::string& subject) {
  access::AuditEvent event;
  event.address = context.peer();
  event.rpc_path = std::string(rpc_path);
  event.subject = subject;
  event.trace_parent = rpc::SentTraceParent(context);
  absl::StatusOr<access::Identity> caller = options_.callers->Of(context);
  if (!caller.ok() && access::AccessOf(access::Role::kNobody, rpc_path) == access::Access::kYes)
    caller = access::Identity();
  if (caller.ok()) event.caller = *caller;
  const access::Rule* rule = access::FindRule(rpc_path);
  auto call = std::make_unique<Call>(this, std::move(event), rule != nullptr && rule->changes);
  absl::Status status = caller.ok() ? Check(*call, rpc_path) : caller.status();
  if (!status.ok()) return Refuse(call.get(), std::move(status));
  if (options_.admitted != nullptr) options_.admitted(call->event_.address);
  return call;
}

void CallGate::NoteRefusal(const access::Identity& caller, absl::string_view rpc_path,
                           const absl::Status& why) {
  access::AuditEvent event;
  event.caller = caller;
  event.rpc_path = std::string(rpc_path);
  Call(this, std::move(event), /*changes=*/false).End(why);
}

absl::StatusOr<std::unique_ptr<CallGate::Call>> CallGate::AdmitStream(grpc::CallbackServerContext* context,
                                                                      absl::string_view rpc_path,
                                                                      const std::string& subject) {
  absl::StatusOr<std::unique_ptr<Call>> call = Admit(*context, rpc_path, subject);
  if (!call.ok()) return call;
  absl::Status status = OpenStream(context, call->get());
  if (status.ok()) return call;
  return Refuse(call->get(), std::move(status));
}

size_t CallGate::EndStalledStreams() {
  return options_.open_calls->EndOverdue(
      options_.now(), absl::DeadlineExceededError(absl::StrCat(
                          "the stream has stalled: its other end neither sent nor took a message for ",
                          absl::FormatDuration(options_.limits.stalled_stream), ", or fewer than ",
                          options_.limits.stalled_file_bytes, " bytes of a file")));
}

absl::Status CallGate::Check(const Call& call, absl::string_view rpc_path) {
  const access::Role role = access::RoleOf(call.caller());
  // A coordinator whose port has no check of its own is closed by the same table.
  if (access::AccessOf(role, rpc_path) == access::Access::kNo)
    return absl::PermissionDeniedError(
        absl::StrCat("the role ", access::NameOf(role), " may not make ", rpc_path.substr(1)));
  return CheckRate(call);
}

absl::Status CallGate::CheckRate(const Call& call) {
  if (call.limit_key().empty()) return absl::OkStatus();
  const bool is_worker = call.caller().kind == access::IdentityKind::kWorker;
  access::TokenBuckets& buckets = is_worker ? worker_requests_ : requests_;
  if (buckets.Take(call.limit_key(), options_.now())) return absl::OkStatus();
  // It passes by itself, so that clients wait and try again.
  return absl::UnavailableError(
      absl::StrCat("too many requests: a caller may make ", buckets.per_second(), " a second"));
}

absl::Status CallGate::OpenStream(grpc::CallbackServerContext* context, Call* call) {
  // By the call and not by the caller, who may be everyone at an address: each watch of a job costs messages
  // with each change of it, a worker that says nothing costs little.
  const bool is_of_worker = absl::StartsWith(call->event_.rpc_path, kWorkerService);
  const int limit = is_of_worker ? options_.limits.streams_per_worker : options_.limits.streams_per_person;
  if (!call->limit_key().empty()) {
    std::string key = absl::StrCat(call->limit_key(), is_of_worker ? " as worker" : "");
    if (!streams_.Add(key, limit)) {
      return absl::ResourceExhaustedError(
          absl::StrCat("too many streams are open: a caller may have ", limit));
    }
    call->stream_key_ = std::move(key);
  }
  // A heartbeat may come as late as its lease lets it.
  call->stall_.emplace(is_of_worker ? std::max(options_.limits.stalled_stream, 2 * options_.lease)
                                    : options_.limits.stalled_stream,
                       options_.limits.stalled_file_bytes);
  call->open_call_ =
      options_.open_calls->Add(call->caller(), [context](const absl::Status&) { context->TryCancel(); });
  // The caller's token may have been revoked since it was looked at, before the call could be ended.
  return options_.callers->Of(*context).status();
}

}  // namespace lumifold::server
