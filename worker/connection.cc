#include "worker/connection.h"

#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <deque>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "lumifold/v1/worker.grpc.pb.h"
#include "proto/rpc/monotonic.h"
#include "proto/rpc/reconnect_schedule.h"
#include "proto/rpc/retry.h"
#include "proto/rpc/status_codec.h"
#include "proto/rpc/version.h"
#include "spdlog/spdlog.h"
#include "worker/asset_cache.h"
#include "worker/remote_sources.h"
#include "worker/render/renderer.h"
#include "worker/spec_cache.h"
#include "worker/unit_renderer.h"
#include "worker/worker_impl.h"

namespace lumifold::worker {
namespace {

/// Time from the start of a stream to its first heartbeat.
constexpr absl::Duration kFirstHeartbeat = absl::Seconds(1);
/// Time limit from the start of a stream to Welcome, connecting included. It does not delay a return: the
/// channel connects meanwhile. Half of it may refuse a coordinator that is busy with many workers.
constexpr absl::Duration kWelcomeTimeout = absl::Seconds(20);
/// Time for a worker that leaves to hear that its units are committed and no grant is under way, after it has
/// handed back the others. A coordinator that takes longer finds the connection broken.
constexpr absl::Duration kLeaveTimeout = absl::Seconds(20);
/// Of `stop`, heartbeats and leaving.
constexpr absl::Duration kPollInterval = absl::Milliseconds(50);
/// A stream that lasted this long was no refusal: the next pause is short.
constexpr absl::Duration kSteadyStream = absl::Seconds(5);
/// Refusals of the identity in a row after which the worker gives up. A new certificate is known to another coordinator over
/// the same database two seconds later at most; the pauses before the sixth refusal are 3 to 6 s together.
constexpr int kIdentityRefusals = 6;

/// The stream of gRPC callbacks. Writes are started from any thread, so a hold keeps the call open until a
/// read fails.
class Stream final : public grpc::ClientBidiReactor<v1::WorkerMessage, v1::CoordinatorMessage>,
                     public Outbox {
 public:
  Stream(grpc::Channel& channel, WorkerImpl* worker, AssignedId* id, spdlog::logger* log)
      : worker_(worker),
        id_(id),
        log_(log),
        stub_(v1::WorkerService::NewStub(std::shared_ptr<grpc::ChannelInterface>(&channel, [](auto*) {}))) {}

  void Start(v1::WorkerMessage hello) {
    // The stream begins as soon as gRPC has connected; otherwise our pauses and gRPC's would add up.
    context_.set_wait_for_ready(true);
    stub_->async()->Work(&context_, this);
    AddHold();
    StartRead(&incoming_);
    StartCall();
    Send(std::move(hello));
  }

  void Send(v1::WorkerMessage message) override {
    absl::MutexLock lock(&mutex_);
    if (closed_) return;
    outgoing_.push_back(std::move(message));
    if (outgoing_.size() == 1) StartWrite(&outgoing_.front());
  }

  void Cancel() { context_.TryCancel(); }

  /// Ends the stream from this side once all messages are sent; further ones are dropped.
  void HalfClose() {
    absl::MutexLock lock(&mutex_);
    if (std::exchange(half_closes_, true) || closed_) return;
    if (outgoing_.empty()) EndWrites();
  }

  /// Waits at most `timeout` for the end of the stream.
  bool WaitUntilDone(absl::Duration timeout) { return done_.WaitFor(timeout); }
  absl::Status result() const { return result_; }
  absl::Duration heartbeat() const {
    absl::MutexLock lock(&mutex_);
    return heartbeat_;
  }
  bool is_welcome() const {
    absl::MutexLock lock(&mutex_);
    return welcome_;
  }

  void OnReadDone(bool ok) override {
    if (!ok) {
      {
        absl::MutexLock lock(&mutex_);
        closed_ = true;
      }
      RemoveHold();
      return;
    }
    if (incoming_.has_welcome()) {
      absl::MutexLock lock(&mutex_);
      welcome_ = true;
      heartbeat_ = absl::Milliseconds(std::max<int64_t>(1, incoming_.welcome().heartbeat_ms()));
      id_->Set(incoming_.welcome().worker_id());
      log_->info("event=joined worker={}", incoming_.welcome().worker_id());
    }
    worker_->OnMessage(incoming_);
    StartRead(&incoming_);
  }

  void OnWriteDone(bool ok) override {
    absl::MutexLock lock(&mutex_);
    outgoing_.pop_front();
    if (!ok || closed_) {
      outgoing_.clear();
      closed_ = true;
      return;
    }
    if (!outgoing_.empty()) {
      StartWrite(&outgoing_.front());
    } else if (half_closes_) {
      EndWrites();
    }
  }

  void OnDone(const grpc::Status& status) override {
    result_ = rpc::StatusFromGrpc(status);
    done_.Notify();
  }

 private:
  void EndWrites() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    closed_ = true;
    StartWritesDone();
  }

  WorkerImpl* worker_;
  AssignedId* id_;
  spdlog::logger* log_;
  std::unique_ptr<v1::WorkerService::Stub> stub_;
  grpc::ClientContext context_;
  v1::CoordinatorMessage incoming_;
  absl::Status result_;
  rpc::MonotonicEvent done_;

  mutable absl::Mutex mutex_;
  absl::Duration heartbeat_ ABSL_GUARDED_BY(mutex_) = kFirstHeartbeat;
  bool welcome_ ABSL_GUARDED_BY(mutex_) = false;
  bool half_closes_ ABSL_GUARDED_BY(mutex_) = false;
  bool closed_ ABSL_GUARDED_BY(mutex_) = false;                     // nothing more is sent
  std::deque<v1::WorkerMessage> outgoing_ ABSL_GUARDED_BY(mutex_);  // the front is being written
};

v1::WorkerMessage MakeHello(const WorkerOptions& options, const WorkerImpl& worker) {
  v1::WorkerMessage message;
  v1::Hello* hello = message.mutable_hello();
  hello->set_name(options.name);
  hello->set_numeric_class(render::NumericClass());
  hello->set_slots(worker.slots());
  hello->set_wire_version(rpc::kWireVersion);
  for (const std::string& tag : options.tags) hello->add_tags(tag);
  hello->set_instance(worker.instance());
  return message;
}

/// Reason of a worker that leaves because of WorkerOptions::exit_when_idle.
constexpr char kIdle[] = "idle";

/// Whether and why the worker shall leave.
class LeaveTrigger {
 public:
  LeaveTrigger(const WorkerOptions& options, const WorkerImpl& worker) : options_(options), worker_(worker) {}

  /// Of v1::Leaving; empty while the worker shall stay.
  std::string Reason() const {
    if (options_.leave != nullptr && options_.leave->HasBeenNotified()) return "signal";
    return rpc::MonotonicNow() - worker_.IdleSince() >= options_.exit_when_idle ? kIdle : "";
  }

 private:
  const WorkerOptions& options_;
  const WorkerImpl& worker_;
};

/// One stream, from Hello to its end.
class Connection {
 public:
  Connection(grpc::Channel& channel, const WorkerOptions& options, WorkerImpl& worker, AssignedId& id,
             spdlog::logger& log)
      : options_(options),
        worker_(worker),
        id_(id),
        // Shared with render threads, which may send after the stream has ended.
        stream_(std::make_shared<Stream>(channel, &worker, &id, &log)) {}

  /// Blocks until the stream has ended: by itself, by `stop`, or because the worker has left.
  absl::Status Run(const LeaveTrigger& trigger, const rpc::MonotonicEvent& stop) {
    worker_.OnConnected(stream_);
    stream_->Start(MakeHello(options_, worker_));
    while (!stream_->WaitUntilDone(kPollInterval)) {
      if (!stream_->is_welcome()) {
        Await(trigger);
      } else {
        Leave(trigger);
        SendHeartbeat();
      }
      if (stop.HasBeenNotified()) stream_->Cancel();
    }
    id_.Set("");
    worker_.OnDisconnected();
    if (!timed_out_) return stream_->result();
    return absl::UnavailableError(
        absl::StrCat("no answer from the coordinator within ", absl::FormatDuration(kWelcomeTimeout)));
  }

  /// The coordinator has welcomed the worker.
  bool was_admitted() const { return stream_->is_welcome(); }

 private:
  void Await(const LeaveTrigger& trigger) {
    timed_out_ = rpc::MonotonicNow() - start_ > kWelcomeTimeout;
    if (timed_out_ || !trigger.Reason().empty()) stream_->Cancel();
  }

  void SendHeartbeat() {
    const absl::Time now = rpc::MonotonicNow();
    if (now < next_heartbeat_) return;
    v1::WorkerMessage message;
    *message.mutable_heartbeat() = worker_.MakeHeartbeat();
    stream_->Send(std::move(message));
    next_heartbeat_ = now + stream_->heartbeat();
  }

  void Leave(const LeaveTrigger& trigger) {
    if (const std::string reason = trigger.Reason(); !reason.empty()) worker_.Leave(reason);
    if (!worker_.IsLeaving()) return;
    const absl::Time now = rpc::MonotonicNow();
    leaving_since_ = std::min(leaving_since_, now);
    if (now - leaving_since_ >= options_.drain) worker_.HandBackUnfinished();
    if (worker_.HasLeft()) stream_->HalfClose();
    if (now - leaving_since_ >= options_.drain + kLeaveTimeout) stream_->Cancel();
  }

  const WorkerOptions& options_;
  WorkerImpl& worker_;
  AssignedId& id_;
  const std::shared_ptr<Stream> stream_;
  const absl::Time start_ = rpc::MonotonicNow();
  absl::Time next_heartbeat_ = start_ + kFirstHeartbeat;
  absl::Time leaving_since_ = absl::InfiniteFuture();
  bool timed_out_ = false;
};

bool IsRefusedIdentity(const absl::Status& status) {
  return absl::IsUnauthenticated(status) || absl::IsPermissionDenied(status);
}

}  // namespace

absl::Status RunWorker(const std::shared_ptr<grpc::Channel>& channel, const WorkerOptions& options,
                       const rpc::MonotonicEvent& stop) {
  const std::shared_ptr<spdlog::logger> log =
      options.log != nullptr ? options.log : std::make_shared<spdlog::logger>("null");  // without sinks
  AssignedId id;
  const std::unique_ptr<AssetSource> assets = MakeRemoteAssetSource(channel, &id);
  AssetCache cache(assets.get(), kAssetCacheBytes);
  UnitRenderer renderer(&cache);
  const std::unique_ptr<SpecSource> spec_source = MakeRemoteSpecSource(channel, &id);
  SpecCache specs(spec_source.get());
  WorkerImpl worker(options.threads, &specs, &renderer, log);
  const LeaveTrigger trigger(options, worker);
  const auto is_over = [&] {
    return stop.HasBeenNotified() || worker.IsLeaving() || !trigger.Reason().empty();
  };
  rpc::ReconnectSchedule schedule(rpc::RetryEnvironment::Real().jitter);
  int identity_refusals = 0;
  bool was_admitted = false;
  while (!is_over()) {
    if (options.check_identity != nullptr) {
      if (absl::Status status = options.check_identity(); !status.ok()) return status;
    }
    const absl::Time start = rpc::MonotonicNow();
    Connection connection(*channel, options, worker, id, *log);
    absl::Status status = connection.Run(trigger, stop);
    was_admitted = was_admitted || connection.was_admitted();
    if (is_over()) break;
    if (absl::IsFailedPrecondition(status) || absl::IsInvalidArgument(status)) return status;
    identity_refusals = IsRefusedIdentity(status) ? identity_refusals + 1 : 0;
    if (identity_refusals == kIdentityRefusals) return status;
    if (rpc::MonotonicNow() - start > kSteadyStream) schedule.Reset();
    const absl::Duration pause = schedule.NextPause();
    log->warn("event=disconnected error=\"{}\" retry_in={:.1f}s", std::string(status.message()),
              absl::ToDoubleSeconds(pause));
    const absl::Time end = rpc::MonotonicNow() + pause;
    while (!is_over() && rpc::MonotonicNow() < end) stop.WaitFor(kPollInterval);
  }
  if (was_admitted || stop.HasBeenNotified() || trigger.Reason() != kIdle) return absl::OkStatus();
  return absl::DeadlineExceededError(
      absl::StrCat("reached no coordinator within ", absl::FormatDuration(options.exit_when_idle)));
}

}  // namespace lumifold::worker
