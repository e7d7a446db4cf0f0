#include "worker/connection/connection.h"

#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <deque>
#include <map>
#include <set>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "filter/manifold/filter_device.h"
#include "lumifold/v1/worker.grpc.pb.h"
#include "proto/logging/fields.h"
#include "proto/monitoring/endpoint.h"
#include "proto/monitoring/process.h"
#include "proto/rpc/monotonic.h"
#include "proto/rpc/retry.h"
#include "proto/rpc/status_codec.h"
#include "proto/rpc/version.h"
#include "proto/threads/event.h"
#include "spdlog/spdlog.h"
#include "worker/cache/asset_cache.h"
#include "worker/cache/asset_folder.h"
#include "worker/cache/counted_assets.h"
#include "worker/cache/spec_cache.h"
#include "worker/connection/remote_sources.h"
#include "worker/connection/route.h"
#include "worker/leases/lease_runner.h"
#include "worker/metrics/worker_metrics.h"
#include "worker/render/renderer.h"
#include "worker/units/unit_renderer.h"

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
/// Time for units that an operator lets a worker finish. What takes longer is handed back.
constexpr absl::Duration kLongestUnit = absl::Hours(24);
/// Of `stop`, heartbeats, resting and leaving.
constexpr absl::Duration kPollInterval = absl::Milliseconds(50);
/// A stream that lasted this long was no refusal: the next pause is short.
constexpr absl::Duration kSteadyStream = absl::Seconds(5);
/// Refusals of the identity without a Welcome, for each coordinator of the list, after which the worker gives
/// up. A new certificate is known to another coordinator over the same database two seconds later at most;
/// the pauses before the sixth refusal are 3 to 6 s together.
constexpr size_t kIdentityRefusals = 6;

/// The stream of gRPC callbacks. Writes are started from any thread, so a hold keeps the call open until a
/// read fails.
class Stream final : public grpc::ClientBidiReactor<v1::WorkerMessage, v1::CoordinatorMessage>,
                     public Outbox {
 public:
  Stream(std::shared_ptr<grpc::Channel> channel, LeaseRunner* worker, CurrentCoordinator* current,
         const WorkerOptions* options)
      : worker_(worker),
        current_(current),
        options_(*options),
        channel_(std::move(channel)),
        stub_(v1::WorkerService::NewStub(channel_)) {}

  /// `waits`: until there is a connection; otherwise the stream ends where the first attempt to connect
  /// fails.
  void Start(v1::WorkerMessage hello, bool waits) {
    context_.set_wait_for_ready(waits);
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
      current_->Set(channel_, incoming_.welcome().worker_id());
      options_.log.labels->SetWorker(absl::StrCat(logging::OneWord(incoming_.welcome().worker_id()), "/",
                                                  logging::OneWord(options_.name)));
      options_.log.log->info("event=joined");
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

  LeaseRunner* worker_;
  CurrentCoordinator* current_;
  const WorkerOptions& options_;
  const std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<v1::WorkerService::Stub> stub_;
  grpc::ClientContext context_;
  v1::CoordinatorMessage incoming_;
  absl::Status result_;
  threads::Event done_;

  mutable absl::Mutex mutex_;
  absl::Duration heartbeat_ ABSL_GUARDED_BY(mutex_) = kFirstHeartbeat;
  bool welcome_ ABSL_GUARDED_BY(mutex_) = false;
  bool half_closes_ ABSL_GUARDED_BY(mutex_) = false;
  bool closed_ ABSL_GUARDED_BY(mutex_) = false;                     // nothing more is sent
  std::deque<v1::WorkerMessage> outgoing_ ABSL_GUARDED_BY(mutex_);  // the front is being written
};

/// The class of a worker and of the frames that it finishes.
std::string ClassOf(const WorkerOptions& options) {
  return render::NumericClass(options.finishing.device == nullptr ? ""
                                                                  : options.finishing.device->OtherBits());
}

v1::WorkerMessage MakeHello(const WorkerOptions& options, const LeaseRunner& worker) {
  v1::WorkerMessage message;
  v1::Hello* hello = message.mutable_hello();
  hello->set_name(options.name);
  hello->set_numeric_class(ClassOf(options));
  hello->set_slots(options.renders ? worker.slots() : 0);
  hello->set_memory_bytes(options.memory_bytes);
  hello->set_wire_version(rpc::kWireVersion);
  for (const std::string& tag : options.tags) hello->add_tags(tag);
  hello->set_instance(worker.instance());
  hello->set_finishes(options.finishing.count);
  hello->set_finish_memory_bytes(options.finishing.memory_bytes);
  hello->set_keep_bytes(options.finishing.keep_bytes);
  return message;
}

/// Reason of a worker that leaves because of WorkerOptions::exit_when_idle.
constexpr char kIdle[] = "idle";

/// Whether and why the worker shall leave.
class LeaveTrigger {
 public:
  LeaveTrigger(const WorkerOptions& options, const LeaseRunner& worker)
      : options_(options), worker_(worker) {}

  /// Of v1::Leaving; empty while the worker shall stay.
  std::string Reason() const {
    if (options_.leave != nullptr && options_.leave->HasBeenNotified()) return "signal";
    return rpc::MonotonicNow() - worker_.IdleSince() >= options_.exit_when_idle ? kIdle : "";
  }

 private:
  const WorkerOptions& options_;
  const LeaseRunner& worker_;
};

/// One stream, from Hello to its end.
class Connection {
 public:
  Connection(std::shared_ptr<grpc::Channel> channel, const WorkerOptions& options, LeaseRunner& worker,
             CurrentCoordinator& current)
      : options_(options),
        worker_(worker),
        current_(current),
        // Shared with render threads, which may send after the stream has ended.
        stream_(std::make_shared<Stream>(std::move(channel), &worker, &current, &options)) {}

  /// Blocks until the stream has ended: by itself, by `stop`, or because the worker has left or moves.
  /// `is_only`: there is no other coordinator to go to.
  absl::Status Run(const LeaveTrigger& trigger, bool is_only, const threads::Event& stop) {
    worker_.OnConnected(stream_);
    // Where there is no other, the stream begins as soon as gRPC has connected: our pauses and gRPC's do not
    // add up.
    stream_->Start(MakeHello(options_, worker_), is_only);
    Rest();  // before the first grant, which is handed back then
    while (!stream_->WaitUntilDone(kPollInterval)) {
      if (options_.alive != nullptr) options_.alive();
      if (!stream_->is_welcome()) {
        Await(trigger);
      } else {
        Leave(trigger);
        Rest();
        SendHeartbeat();
      }
      if (stop.HasBeenNotified()) stream_->Cancel();
    }
    current_.Clear();
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
    if (!worker_.IsLeaving() && !worker_.IsMoving()) return;
    const absl::Time now = rpc::MonotonicNow();
    leaving_since_ = std::min(leaving_since_, now);
    const absl::Duration drain = worker_.FinishesUnits() ? kLongestUnit : options_.drain;
    if (now - leaving_since_ >= drain) worker_.HandBackUnfinished();
    if (worker_.HasLeft()) stream_->HalfClose();
    if (now - leaving_since_ >= drain + kLeaveTimeout) stream_->Cancel();
  }

  void Rest() {
    if (options_.rest_reason == nullptr) return;
    const std::string reason = options_.rest_reason();
    worker_.Rest(reason);
    const absl::Time now = rpc::MonotonicNow();
    resting_since_ = reason.empty() ? absl::InfiniteFuture() : std::min(resting_since_, now);
    if (now - resting_since_ >= options_.drain) worker_.HandBackUnfinished();
  }

  const WorkerOptions& options_;
  LeaseRunner& worker_;
  CurrentCoordinator& current_;
  const std::shared_ptr<Stream> stream_;
  const absl::Time start_ = rpc::MonotonicNow();
  absl::Time next_heartbeat_ = start_ + kFirstHeartbeat;
  absl::Time leaving_since_ = absl::InfiniteFuture();
  absl::Time resting_since_ = absl::InfiniteFuture();
  bool timed_out_ = false;
};

/// The channels to the coordinators of the list.
class Channels {
 public:
  explicit Channels(const Coordinators* coordinators) : coordinators_(*coordinators) {}

  /// Errors: those of Coordinators::connect, as kUnavailable.
  absl::StatusOr<std::shared_ptr<grpc::Channel>> To(const std::string& address) {
    if (const auto found = channels_.find(address); found != channels_.end()) {
      // Otherwise gRPC's pauses would be added to those of the route.
      grpc::experimental::ChannelResetConnectionBackoff(found->second.get());
      return found->second;
    }
    absl::StatusOr<std::shared_ptr<grpc::Channel>> channel = coordinators_.connect(address);
    if (!channel.ok()) return absl::UnavailableError(channel.status().message());
    const std::vector<std::string>& listed = coordinators_.addresses;
    if (std::find(listed.begin(), listed.end(), address) != listed.end()) channels_[address] = *channel;
    return channel;
  }

 private:
  const Coordinators& coordinators_;
  std::map<std::string, std::shared_ptr<grpc::Channel>> channels_;
};

/// Refusals since the last Welcome: one coordinator that refuses is no reason to give up where another may
/// not.
class Refusals {
 public:
  explicit Refusals(size_t coordinators) : coordinators_(coordinators) {}

  void Clear() {
    refused_by_.clear();
    of_identity_ = 0;
  }
  /// Notes the end of a connection; whether it is the last.
  bool IsLast(const std::string& address, const absl::Status& status) {
    if (absl::IsFailedPrecondition(status) || absl::IsInvalidArgument(status)) refused_by_.insert(address);
    if (absl::IsUnauthenticated(status) || absl::IsPermissionDenied(status)) ++of_identity_;
    return refused_by_.size() >= coordinators_ || of_identity_ >= kIdentityRefusals * coordinators_;
  }

 private:
  const size_t coordinators_;
  std::set<std::string> refused_by_;
  size_t of_identity_ = 0;
};

/// Connects a worker to one coordinator after the other.
class ReconnectLoop {
 public:
  ReconnectLoop(const Coordinators* coordinators, const WorkerOptions& options, LeaseRunner& worker,
                CurrentCoordinator& current, const threads::Event& stop)
      : options_(options),
        worker_(worker),
        current_(current),
        stop_(stop),
        trigger_(options, worker),
        channels_(coordinators),
        route_(coordinators->addresses, rpc::RetryEnvironment::Real().jitter),
        refusals_(coordinators->addresses.size()) {}

  absl::Status Run() {
    while (!IsOver()) {
      if (options_.check_identity != nullptr) {
        if (absl::Status status = options_.check_identity(); !status.ok()) return status;
      }
      const absl::Time start = rpc::MonotonicNow();
      absl::Status status = ConnectOnce();
      if (IsOver()) break;
      std::optional<std::string> address = worker_.TakeMove();
      if (address.has_value() && !address->empty()) {
        route_.MoveTo(*std::move(address));
        continue;
      }
      if (refusals_.IsLast(route_.current(), status)) return status;
      Pause(status, route_.Leave(rpc::MonotonicNow() - start > kSteadyStream));
    }
    if (was_admitted_ || stop_.HasBeenNotified() || trigger_.Reason() != kIdle) return absl::OkStatus();
    return absl::DeadlineExceededError(
        absl::StrCat("reached no coordinator within ", absl::FormatDuration(options_.exit_when_idle)));
  }

 private:
  bool IsOver() const { return stop_.HasBeenNotified() || worker_.IsLeaving() || !trigger_.Reason().empty(); }

  absl::Status ConnectOnce() {
    absl::StatusOr<std::shared_ptr<grpc::Channel>> channel = channels_.To(route_.current());
    if (!channel.ok()) return channel.status();
    Connection connection(*std::move(channel), options_, worker_, current_);
    absl::Status status = connection.Run(trigger_, route_.IsOnly(), stop_);
    if (connection.was_admitted()) {
      was_admitted_ = true;
      refusals_.Clear();
    }
    return status;
  }

  void Pause(const absl::Status& status, absl::Duration pause) {
    options_.log.log->warn("event=disconnected error={} retry_in={:.1f}s server={}",
                           logging::Quoted(status.message()), absl::ToDoubleSeconds(pause), route_.current());
    const absl::Time end = rpc::MonotonicNow() + pause;
    while (!IsOver() && rpc::MonotonicNow() < end) {
      if (options_.alive != nullptr) options_.alive();
      stop_.WaitFor(kPollInterval);
    }
  }

  const WorkerOptions& options_;
  LeaseRunner& worker_;
  CurrentCoordinator& current_;
  const threads::Event& stop_;
  const LeaveTrigger trigger_;
  Channels channels_;
  Route route_;
  Refusals refusals_;
  bool was_admitted_ = false;
};

/// The parts of a worker. Later ones use earlier ones.
class Worker {
 public:
  explicit Worker(const WorkerOptions& options)
      : options_(options),
        assets_(MakeRemoteAssetSource(&current_, options.log.labels)),
        folder_(
            &fetched_,
            {.path = options.assets.folder, .max_bytes = options.assets.max_bytes, .log = options.log.log}),
        spec_source_(MakeRemoteSpecSource(&current_, options.log.labels)),
        frame_link_(MakeRemoteFrameLink(&current_, options.log.labels)),
        impl_(options.threads, &specs_, &renderer_, options.log,
              {.link = frame_link_.get(),
               .numeric_class = ClassOf(options),
               .device = options.finishing.device}) {}

  absl::Status Run(const Coordinators& coordinators, const threads::Event& stop) {
    std::unique_ptr<monitoring::Endpoint> endpoint;
    if (options_.metrics != nullptr) {
      absl::StatusOr<std::unique_ptr<monitoring::Endpoint>> started = monitoring::Endpoint::Start(
          {.sockets = options_.metrics,
           .sources = {monitoring::MakeWorkerMetrics([this] { return Metrics(); }),
                       monitoring::MakeProcessMetrics()},
           .now = rpc::MonotonicNow});
      if (!started.ok()) return started.status();
      endpoint = *std::move(started);
    }
    return ReconnectLoop(&coordinators, options_, impl_, current_, stop).Run();
  }

 private:
  monitoring::WorkerMetrics Metrics() const {
    monitoring::WorkerMetrics metrics = impl_.Metrics();
    metrics.is_connected = current_.Get().channel != nullptr;
    metrics.connections = current_.connections();
    const UnitRenderer::Loads loads = renderer_.loads();
    metrics.scenes_loaded = loads.scenes;
    metrics.load_time = loads.time;
    metrics.assets = {
        {"coordinator", fetched_.assets()}, {"folder", folder_.hits()}, {"memory", cache_.hits()}};
    metrics.asset_bytes_received = fetched_.bytes();
    metrics.asset_cache_bytes = cache_.bytes();
    return metrics;
  }

  const WorkerOptions& options_;
  CurrentCoordinator current_;
  const std::unique_ptr<AssetSource> assets_;
  CountedAssets fetched_{assets_.get()};
  AssetFolder folder_;
  AssetCache cache_{options_.assets.folder.empty() ? static_cast<AssetSource*>(&fetched_) : &folder_,
                    kAssetCacheBytes};
  UnitRenderer renderer_{&cache_, options_.threads};
  const std::unique_ptr<SpecSource> spec_source_;
  SpecCache specs_{spec_source_.get()};
  const std::unique_ptr<FrameLink> frame_link_;
  LeaseRunner impl_;
};

}  // namespace

absl::Status RunWorker(const Coordinators& coordinators, const WorkerOptions& options,
                       const threads::Event& stop) {
  return Worker(options).Run(coordinators, stop);
}

}  // namespace lumifold::worker
