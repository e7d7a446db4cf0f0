#include "worker/connection.h"

#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <deque>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "lumifold/v1/worker.grpc.pb.h"
#include "proto/rpc/checksum.h"
#include "proto/rpc/monotonic.h"
#include "proto/rpc/reconnect_schedule.h"
#include "proto/rpc/retry.h"
#include "proto/rpc/sha256.h"
#include "proto/rpc/status_codec.h"
#include "proto/rpc/version.h"
#include "spdlog/spdlog.h"
#include "worker/asset_cache.h"
#include "worker/render/renderer.h"
#include "worker/unit_renderer.h"
#include "worker/worker_impl.h"

namespace lumifold::worker {
namespace {

/// Time from the start of a stream to its first heartbeat.
constexpr absl::Duration kFirstHeartbeat = absl::Seconds(1);
/// Time limit from the start of a stream to Welcome, connecting included. It does not delay a return: the
/// channel connects meanwhile. Half of it may refuse a coordinator that is busy with many workers.
constexpr absl::Duration kWelcomeTimeout = absl::Seconds(20);
/// A stream that lasted this long was no refusal: the next pause is short.
constexpr absl::Duration kSteadyStream = absl::Seconds(5);
/// Time limit of one transfer of an asset; large scenes may be sent over slow networks.
constexpr absl::Duration kAssetTimeout = absl::Minutes(10);

class RemoteAssetSource final : public AssetSource {
 public:
  explicit RemoteAssetSource(std::shared_ptr<grpc::Channel> channel)
      : stub_(v1::WorkerService::NewStub(std::move(channel))) {}

  absl::StatusOr<std::string> Fetch(const v1::AssetRef& asset) override {
    std::string bytes;
    rpc::RetryPolicy policy;
    policy.try_timeout = kAssetTimeout;
    policy.total_timeout = 2 * kAssetTimeout;
    const absl::Status status =
        rpc::CallWithRetry(policy, rpc::Idempotency::kIdempotent, rpc::RetryEnvironment::Real(),
                           [&](grpc::ClientContext& context) { return Continue(asset, context, &bytes); });
    if (!status.ok()) return status;
    if (rpc::Sha256Hex(bytes) != asset.sha256()) {
      return absl::DataLossError(absl::StrCat("asset ", asset.sha256(), " does not match its SHA-256"));
    }
    return bytes;
  }

 private:
  /// Appends the missing bytes of the asset to *bytes.
  absl::Status Continue(const v1::AssetRef& asset, grpc::ClientContext& context, std::string* bytes) const {
    v1::FetchAssetRequest request;
    request.set_sha256(asset.sha256());
    request.set_offset(bytes->size());
    const std::unique_ptr<grpc::ClientReader<v1::ByteChunk>> reader = stub_->FetchAsset(&context, request);
    v1::ByteChunk chunk;
    while (reader->Read(&chunk)) {
      if (chunk.offset() != bytes->size() || chunk.checksum() != rpc::Checksum(chunk.data()) ||
          bytes->size() + chunk.data().size() > asset.size()) {
        context.TryCancel();
        reader->Finish();
        return absl::UnavailableError(absl::StrCat("asset ", asset.sha256(), " was damaged in transit"));
      }
      bytes->append(chunk.data());
    }
    absl::Status status = rpc::StatusFromGrpc(reader->Finish());
    if (status.ok() && bytes->size() != asset.size()) status = absl::UnavailableError("asset ended early");
    return status;
  }

  std::unique_ptr<v1::WorkerService::Stub> stub_;
};

/// The stream of gRPC callbacks. Writes are started from any thread, so a hold keeps the call open until a
/// read fails.
class Stream final : public grpc::ClientBidiReactor<v1::WorkerMessage, v1::CoordinatorMessage>,
                     public Outbox {
 public:
  Stream(grpc::Channel& channel, WorkerImpl* worker, spdlog::logger* log)
      : worker_(worker),
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
    if (!outgoing_.empty()) StartWrite(&outgoing_.front());
  }

  void OnDone(const grpc::Status& status) override {
    result_ = rpc::StatusFromGrpc(status);
    done_.Notify();
  }

 private:
  WorkerImpl* worker_;
  spdlog::logger* log_;
  std::unique_ptr<v1::WorkerService::Stub> stub_;
  grpc::ClientContext context_;
  v1::CoordinatorMessage incoming_;
  absl::Status result_;
  rpc::MonotonicEvent done_;

  mutable absl::Mutex mutex_;
  absl::Duration heartbeat_ ABSL_GUARDED_BY(mutex_) = kFirstHeartbeat;
  bool welcome_ ABSL_GUARDED_BY(mutex_) = false;
  bool closed_ ABSL_GUARDED_BY(mutex_) = false;
  std::deque<v1::WorkerMessage> outgoing_ ABSL_GUARDED_BY(mutex_);  // the front is being written
};

v1::WorkerMessage MakeHello(const std::string& name, int slots) {
  v1::WorkerMessage message;
  v1::Hello* hello = message.mutable_hello();
  hello->set_name(name);
  hello->set_numeric_class(render::NumericClass());
  hello->set_slots(slots);
  hello->set_wire_version(rpc::kWireVersion);
  return message;
}

/// Runs one stream, from Hello to its end or `stop`.
absl::Status RunConnection(grpc::Channel& channel, const std::string& name, WorkerImpl& worker,
                           spdlog::logger& log, const rpc::MonotonicEvent& stop) {
  // Shared with render threads, which may send after the stream has ended.
  const auto stream = std::make_shared<Stream>(channel, &worker, &log);
  worker.OnConnected(stream);
  stream->Start(MakeHello(name, worker.slots()));
  constexpr absl::Duration kPollInterval = absl::Milliseconds(50);  // of `stop`
  const absl::Time start = rpc::MonotonicNow();
  absl::Time next_heartbeat = start + kFirstHeartbeat;
  bool timed_out = false;
  while (!stream->WaitUntilDone(kPollInterval)) {
    const absl::Time now = rpc::MonotonicNow();
    timed_out = !stream->is_welcome() && now - start > kWelcomeTimeout;
    if (timed_out || stop.HasBeenNotified()) stream->Cancel();
    if (now < next_heartbeat || !stream->is_welcome()) continue;
    v1::WorkerMessage message;
    *message.mutable_heartbeat() = worker.MakeHeartbeat();
    stream->Send(std::move(message));
    next_heartbeat = now + stream->heartbeat();
  }
  worker.OnDisconnected();
  if (stop.HasBeenNotified()) return absl::OkStatus();
  if (timed_out) {
    return absl::UnavailableError(
        absl::StrCat("no answer from the coordinator within ", absl::FormatDuration(kWelcomeTimeout)));
  }
  return stream->result();
}

}  // namespace

std::unique_ptr<AssetSource> MakeRemoteAssetSource(std::shared_ptr<grpc::Channel> channel) {
  return std::make_unique<RemoteAssetSource>(std::move(channel));
}

absl::Status RunWorker(std::shared_ptr<grpc::Channel> channel, WorkerOptions options,
                       const rpc::MonotonicEvent& stop) {
  const std::shared_ptr<spdlog::logger> log =
      options.log != nullptr ? options.log : std::make_shared<spdlog::logger>("null");  // without sinks
  const std::unique_ptr<AssetSource> assets = MakeRemoteAssetSource(channel);
  AssetCache cache(assets.get(), kAssetCacheBytes);
  UnitRenderer renderer(&cache);
  WorkerImpl worker(options.threads, &renderer, log);
  rpc::ReconnectSchedule schedule(rpc::RetryEnvironment::Real().jitter);
  while (!stop.HasBeenNotified()) {
    const absl::Time start = rpc::MonotonicNow();
    const absl::Status status = RunConnection(*channel, options.name, worker, *log, stop);
    if (stop.HasBeenNotified()) break;
    if (absl::IsFailedPrecondition(status) || absl::IsInvalidArgument(status)) return status;
    if (rpc::MonotonicNow() - start > kSteadyStream) schedule.Reset();
    const absl::Duration pause = schedule.NextPause();
    log->warn("event=disconnected error=\"{}\" retry_in={:.1f}s", std::string(status.message()),
              absl::ToDoubleSeconds(pause));
    stop.WaitFor(pause);
  }
  return absl::OkStatus();
}

}  // namespace lumifold::worker
