#pragma once

#include <grpcpp/grpcpp.h>

#include <atomic>
#include <memory>
#include <string>
#include <vector>

#include "lumifold/v1/farm.grpc.pb.h"
#include "lumifold/v1/worker.grpc.pb.h"
#include "server/access/open_calls.h"
#include "server/assets/asset_checks.h"
#include "server/cluster/farm_peers.h"
#include "server/coordinator/event_log.h"
#include "server/preview/preview_maker.h"
#include "server/services/call_gate.h"
#include "tests/unit/server/coordinator_fixture.h"

namespace lumifold::server {

/// Believes the metadata "caller": "person/ann/submit", "worker/node-7", "local". Without it nobody calls.
class BelievedCallers final : public access::Callers {
 public:
  absl::StatusOr<access::Identity> Of(const grpc::CallbackServerContext& context) const override;
};

/// The calls of a coordinator as their callers see them: through the services and their gate, inside the
/// process.
class GateFixture : public CoordinatorFixture {
 protected:
  ~GateFixture() override { StopGate(); }

  /// Starts a coordinator, if there is none, and its services.
  void StartGate(const CallLimits& calls = {}, const JobLimits& jobs = {});
  void StopGate();

  /// A call's context in the name of a caller; empty: nobody.
  static std::unique_ptr<grpc::ClientContext> As(const std::string& caller);
  v1::FarmService::Stub& farm() { return *farm_; }
  v1::WorkerService::Stub& workers() { return *workers_; }
  std::shared_ptr<grpc::Channel> channel() const { return channel_; }

  /// Makes a unary call of FarmService.
  template <typename Request, typename Response>
  grpc::Status Call(const std::string& caller,
                    grpc::Status (v1::FarmService::Stub::*method)(grpc::ClientContext*, const Request&,
                                                                  Response*),
                    const Request& request, Response* response) {
    const auto context = As(caller);
    return (farm_.get()->*method)(context.get(), request, response);
  }
  /// Makes any call by its path, with an empty message, until its end; the end of one that has none is its
  /// first answer.
  grpc::Status CallByPath(const std::string& caller, const std::string& path);
  /// Submits Spec() in the name of a caller; `user` is scheduling.user.
  grpc::Status SubmitAs(const std::string& caller, const std::string& request_id, const std::string& user,
                        std::string* job_id);
  /// Stores the scene of Spec().
  void StoreScene();
  std::string AuditText();

  /// Moves the gate's clock, which streams read at the same time.
  void Advance(absl::Duration duration) { seconds_ = seconds_ + absl::ToDoubleSeconds(duration); }
  size_t EndStalledStreams() { return gate_->EndStalledStreams(); }
  /// How often the gate's clock was read: streams do so when they begin to wait for their other end, and when
  /// it moves.
  int clock_reads() const { return clock_reads_; }

  access::OpenCalls open_calls_;
  std::atomic<int> shut_out_ = 0;  // calls of CallGate::Options::shut_out

 private:
  absl::Time Now();

  std::atomic<double> seconds_ = 0;
  std::atomic<int> clock_reads_ = 0;
  EventLog events_;
  BelievedCallers callers_;
  std::unique_ptr<access::AuditLog> audit_;
  std::unique_ptr<AssetChecks> checks_;
  std::unique_ptr<CallGate> gate_;
  cluster::FarmPeers peers_;  // none
  std::unique_ptr<PreviewMaker> previews_;
  std::vector<std::unique_ptr<grpc::Service>> services_;
  std::unique_ptr<grpc::Server> server_;
  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<v1::FarmService::Stub> farm_;
  std::unique_ptr<v1::WorkerService::Stub> workers_;
};

}  // namespace lumifold::server
