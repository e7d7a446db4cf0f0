#pragma once

#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <memory>
#include <string>

#include "lumifold/v1/worker.grpc.pb.h"
#include "proto/rpc/version.h"

namespace lumifold::server {

/// A worker that holds what it is leased and delivers nothing, until its destruction.
class HoldingWorker {
 public:
  explicit HoldingWorker(const std::shared_ptr<grpc::Channel>& channel)
      : stub_(v1::WorkerService::NewStub(channel)), stream_(stub_->Work(&context_)) {
    v1::WorkerMessage message;
    message.mutable_hello()->set_name("holder");
    message.mutable_hello()->set_numeric_class("test");
    message.mutable_hello()->set_slots(1);
    message.mutable_hello()->set_wire_version(rpc::kWireVersion);
    stream_->Write(message);
    v1::CoordinatorMessage welcome;
    EXPECT_TRUE(stream_->Read(&welcome));
    id_ = welcome.welcome().worker_id();
  }
  ~HoldingWorker() {
    context_.TryCancel();
    stream_->Finish();
  }

  /// Of Welcome.
  const std::string& id() const { return id_; }
  /// Waits for a grant; its job.
  std::string AwaitGrant() {
    v1::CoordinatorMessage message;
    while (stream_->Read(&message)) {
      if (message.grant().leases_size() > 0) return message.grant().leases(0).unit().job_id();
    }
    return "";
  }

 private:
  grpc::ClientContext context_;
  const std::unique_ptr<v1::WorkerService::Stub> stub_;
  const std::unique_ptr<grpc::ClientReaderWriter<v1::WorkerMessage, v1::CoordinatorMessage>> stream_;
  std::string id_;
};

}  // namespace lumifold::server
