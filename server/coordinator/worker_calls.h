#pragma once

#include <memory>
#include <string>

#include "server/commit/committer.h"
#include "server/coordinator/farm_state.h"
#include "server/coordinator/finish_delivery.h"
#include "server/coordinator/plan_delivery.h"
#include "server/coordinator/resources.h"
#include "server/coordinator/roles.h"
#include "server/coordinator/scene_files.h"

namespace lumifold::server {

/// What workers tell the coordinator, and what they fetch.
/// Threads: safe.
class WorkerCalls final : public WorkerApi {
 public:
  /// All must outlive it.
  WorkerCalls(Resources* resources, FarmState* state, Committer* committer, FrameFinishing* finishing)
      : resources_(resources),
        state_(state),
        committer_(committer),
        scene_files_(resources, state),
        plans_(resources, state, committer),
        finishing_(resources, state, finishing) {}

  absl::StatusOr<job::WorkerId> AddWorker(const v1::Hello& hello, const access::Identity& caller,
                                          WorkerSink* sink) override;
  void RemoveWorker(job::WorkerId worker) override;
  void OnHeartbeat(job::WorkerId worker, const v1::Heartbeat& heartbeat) override;
  void KeepLog(job::WorkerId worker, const google::protobuf::RepeatedPtrField<v1::LogEvent>& lines) override;
  void OnLeaving(job::WorkerId worker, const std::string& reason) override;
  void OnRest(job::WorkerId worker, const std::string& reason) override;

  std::optional<LeasedUnit> FindLease(job::WorkerId worker, const job::UnitRef& unit,
                                      job::Attempt attempt) override;
  void Deliver(job::WorkerId worker, film::EncodedUnit unit) override;
  void Keep(job::WorkerId worker, const KeptUnit& kept) override;
  absl::Status DeliverPlan(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                           const v1::Plan& plan) override {
    return plans_.Deliver(worker, unit, attempt, plan);
  }
  void Dismiss(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt) override;
  void RefuseUnit(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                  const std::string& reason) override;
  void FailUnit(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                const scheduler::UnitFailure& failure) override;
  void HandBack(job::WorkerId worker, const v1::HandBack& message) override;

  absl::StatusOr<v1::JobSpec> FetchSpec(const v1::FetchSpecRequest& request,
                                        const std::string& caller) override {
    return scene_files_.FetchSpec(request, caller);
  }
  absl::Status CheckFetch(const v1::FetchAssetRequest& request, const std::string& caller) override {
    return scene_files_.CheckFetch(request, caller);
  }
  absl::StatusOr<rpc::ByteSender> OpenAsset(const v1::FetchAssetRequest& request) const override {
    return scene_files_.OpenAsset(request);
  }
  absl::StatusOr<UnitSender> OpenUnits(const v1::FetchUnitsRequest& request,
                                       const std::string& caller) override {
    return finishing_.OpenUnits(request, caller);
  }
  absl::StatusOr<std::unique_ptr<ResultUpload>> ReceiveResult(const v1::ResultAnnouncement& announcement,
                                                              const std::string& caller) override {
    return finishing_.Receive(announcement, caller);
  }
  void OnAssetMissing(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                      const std::string& sha256, const std::string& error) override;

 private:
  Resources* const resources_;
  FarmState* const state_;
  Committer* const committer_;
  const SceneFiles scene_files_;
  const PlanDelivery plans_;
  const FinishDelivery finishing_;
};

}  // namespace lumifold::server
