#pragma once

#include <grpcpp/support/server_callback.h>

#include <atomic>
#include <cstdint>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "lumifold/v1/image.pb.h"
#include "proto/rpc/status_codec.h"
#include "server/services/unary_calls.h"

/// Reactors of streams that the services have in common. A reactor exists from the start of its call to
/// OnDone, where it deletes itself.
namespace lumifold::server {

/// A stream that is refused.
template <typename Reactor>
class Refused final : public Reactor {
 public:
  explicit Refused(const absl::Status& status) { this->Finish(rpc::GrpcFromStatus(status)); }
  void OnDone() override { delete this; }
};

/// Streams a file to the caller, from Start on. `Sender` has its pieces, as rpc::ByteSender.
template <typename Sender>
class FileWriter final : public grpc::ServerWriteReactor<v1::ByteChunk> {
 public:
  /// Adds the bytes that it has sent to `sent`, which must outlive it.
  FileWriter(AdmittedCall call, std::atomic<int64_t>* sent) : call_(std::move(call)), sent_(*sent) {}

  void Start(absl::StatusOr<Sender> sender) {
    sender_ = std::move(sender);
    WriteNext();
  }

  void OnWriteDone(bool ok) override {
    call_->PeerMoved(chunk_.data().size());
    if (ok) {
      sent_ += static_cast<int64_t>(chunk_.data().size());
      WriteNext();
    } else {
      Finish(grpc::Status::CANCELLED);
    }
  }
  void OnDone() override { delete this; }

 private:
  void WriteNext() {
    if (!sender_.ok()) {
      call_->End(sender_.status());
      return Finish(rpc::GrpcFromStatus(sender_.status()));
    }
    const absl::StatusOr<bool> has_next = sender_->Next(&chunk_);
    if (!has_next.ok() || !*has_next) return Finish(rpc::GrpcFromStatus(has_next.status()));
    call_->AwaitPeer();
    StartWrite(&chunk_);
  }

  const AdmittedCall call_;
  std::atomic<int64_t>& sent_;
  absl::StatusOr<Sender> sender_ = absl::UnknownError("not started");
  v1::ByteChunk chunk_;
};

}  // namespace lumifold::server
