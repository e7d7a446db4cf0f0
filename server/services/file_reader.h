#pragma once

#include <grpcpp/support/server_callback.h>

#include <optional>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/synchronization/mutex.h"
#include "proto/rpc/status_codec.h"
#include "server/services/unary_calls.h"

namespace lumifold::server {

/// Receives a file: the first message announces it, all others are its pieces. A `Target` takes them:
/// SubjectOf names what an announcement is about, Announce begins, Add takes a piece, Finish ends; its
/// destruction drops what is not complete. A reactor exists from the start of its call to OnDone, where it
/// deletes itself.
template <typename Request, typename Target>
class FileReader final : public grpc::ServerReadReactor<Request> {
 public:
  FileReader(AdmittedCall call, Target target) : call_(std::move(call)), target_(std::move(target)) {
    call_->SetEnd([this](const absl::Status& why) {
      absl::MutexLock lock(&mutex_);
      EndWith(why);
    });
    absl::MutexLock lock(&mutex_);
    ReadNext();
  }

  void OnReadDone(bool ok) override {
    call_->PeerMoved(ok ? request_.chunk().data().size() : 0);
    if (HasEnded()) {
      target_.reset();
      return;
    }
    const absl::Status status = ok ? Take() : End();
    const bool goes_on = ok && status.ok();
    if (!goes_on)
      target_.reset();  // first, so that what has arrived is kept before the caller gets the error
    absl::MutexLock lock(&mutex_);
    if (!goes_on) {
      EndWith(status);
    } else if (!ended_) {
      ReadNext();
    }
  }
  void OnDone() override { delete this; }

 private:
  bool HasEnded() {
    absl::MutexLock lock(&mutex_);
    return ended_;
  }
  void ReadNext() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    call_->AwaitPeer();
    this->StartRead(&request_);
  }
  // A read that is under way then fails.
  void EndWith(const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (std::exchange(ended_, true)) return;
    call_->End(status);
    this->Finish(rpc::GrpcFromStatus(status));
  }

  absl::Status Take() {
    if (request_.has_announce() == is_announced_)
      return absl::InvalidArgumentError("upload: the first message, and no other, must announce the file");
    if (is_announced_) return target_->Add(request_.chunk());
    is_announced_ = true;
    {
      absl::MutexLock lock(&mutex_);  // the call may be ended meanwhile
      call_->SetSubject(Target::SubjectOf(request_));
    }
    return target_->Announce(request_);
  }

  absl::Status End() {
    if (!is_announced_) return absl::InvalidArgumentError("upload: no file was announced");
    return target_->Finish();
  }

  const AdmittedCall call_;
  Request request_;
  bool is_announced_ = false;
  std::optional<Target> target_;  // used by OnReadDone only, which runs on one thread at a time
  absl::Mutex mutex_;
  bool ended_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace lumifold::server
