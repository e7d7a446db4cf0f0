#include "server/cluster/remote_watch.h"

#include <grpcpp/support/client_callback.h>

#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "lumifold/v1/farm.grpc.pb.h"
#include "proto/rpc/status_codec.h"

namespace lumifold::cluster {
namespace {

class RemoteWatchImpl final : public RemoteWatch, public grpc::ClientReadReactor<v1::JobStatus> {
 public:
  RemoteWatchImpl(const FarmPeers::Peer& peer, v1::WatchJobRequest request, Listener listener)
      : address_(peer.address),
        request_(std::move(request)),
        stub_(v1::FarmService::NewStub(peer.channel)),
        listener_(std::move(listener)) {}

  void Begin(const FarmPeers& peers, const access::Identity& caller, const std::string& trace_parent,
             std::shared_ptr<RemoteWatchImpl> self) {
    self_ = std::move(self);
    peers.PrepareStream(caller, trace_parent, &context_);
    stub_->async()->WatchJob(&context_, &request_, this);
    StartRead(&status_);
    StartCall();
  }

  void Stop() override {
    {
      absl::MutexLock lock(&mutex_);
      listener_ = {};
    }
    context_.TryCancel();
  }

  void OnReadDone(bool ok) override {
    if (!ok) return;
    {
      absl::MutexLock lock(&mutex_);
      if (listener_.on_status != nullptr) listener_.on_status(status_);
    }
    StartRead(&status_);
  }

  void OnDone(const grpc::Status& status) override {
    {
      absl::MutexLock lock(&mutex_);
      if (listener_.on_end != nullptr && !status.ok())
        listener_.on_end(FarmPeers::ErrorOf(address_, rpc::StatusFromGrpc(status)));
      listener_ = {};
    }
    const std::shared_ptr<RemoteWatchImpl> last = std::move(self_);
  }

 private:
  const std::string address_;
  const v1::WatchJobRequest request_;
  const std::unique_ptr<v1::FarmService::Stub> stub_;
  grpc::ClientContext context_;
  v1::JobStatus status_;
  std::shared_ptr<RemoteWatchImpl> self_;  // until OnDone
  absl::Mutex mutex_;
  Listener listener_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace

std::shared_ptr<RemoteWatch> RemoteWatch::Start(const FarmPeers::Peer& peer, const FarmPeers& peers,
                                                const access::Identity& caller,
                                                const std::string& trace_parent,
                                                const v1::WatchJobRequest& request, Listener listener) {
  auto watch = std::make_shared<RemoteWatchImpl>(peer, request, std::move(listener));
  watch->Begin(peers, caller, trace_parent, watch);
  return watch;
}

}  // namespace lumifold::cluster
