#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/synchronization/mutex.h"
#include "server/ledger/job_store.h"

namespace lumifold::server {

/// Passes every call on to another store, after Before: an error of Before is the answer.
class StoreWrapper : public ledger::JobStore {
 public:
  explicit StoreWrapper(std::unique_ptr<ledger::JobStore> store) : store_(std::move(store)) {}

  absl::StatusOr<ledger::Epoch> NewEpoch(ledger::Epoch floor) override {
    return Call("NewEpoch", [&] { return store_->NewEpoch(floor); });
  }
  absl::StatusOr<job::JobId> CreateJob(const ledger::NewJob& job) override {
    return Call("CreateJob", [&] { return store_->CreateJob(job); });
  }
  absl::StatusOr<std::optional<job::JobId>> FindRequest(const ledger::NewJob& job) override {
    return Call("FindRequest", [&] { return store_->FindRequest(job); });
  }
  absl::StatusOr<ledger::ClaimedJobs> ClaimUnfinishedJobs(const ledger::Owner& owner) override {
    return Call("ClaimUnfinishedJobs", [&] { return store_->ClaimUnfinishedJobs(owner); });
  }
  absl::StatusOr<ledger::JobRecord> GetJob(const job::JobId& job) override {
    return Call("GetJob", [&] { return store_->GetJob(job); });
  }
  absl::StatusOr<ledger::JobPage> ListJobs(const ledger::JobFilter& filter) override {
    return Call("ListJobs", [&] { return store_->ListJobs(filter); });
  }
  absl::StatusOr<std::vector<absl::Status>> CommitUnits(
      absl::Span<const ledger::JobCommit> commits) override {
    return Call("CommitUnits", [&] { return store_->CommitUnits(commits); });
  }
  absl::Status RevokeUnits(const ledger::OwnedJob& job, absl::Span<const job::UnitKey> units) override {
    return Call("RevokeUnits", [&] { return store_->RevokeUnits(job, units); });
  }
  absl::Status ForEachUnit(const job::JobId& job, std::optional<int32_t> frame,
                           absl::FunctionRef<void(const ledger::UnitRecord&)> visit) override {
    return Call("ForEachUnit", [&] { return store_->ForEachUnit(job, frame, visit); });
  }
  absl::StatusOr<std::vector<ledger::JobUsage>> Usage(const ledger::UsageFilter& filter) override {
    return Call("Usage", [&] { return store_->Usage(filter); });
  }
  absl::Status RecordFrame(const ledger::OwnedJob& job, int32_t frame,
                           const v1::FrameReport& report) override {
    return Call("RecordFrame", [&] { return store_->RecordFrame(job, frame, report); });
  }
  absl::Status RecordKeptFrame(const ledger::JobCommit& units, int32_t frame,
                               const v1::FrameReport& report) override {
    return Call("RecordKeptFrame", [&] { return store_->RecordKeptFrame(units, frame, report); });
  }
  absl::StatusOr<std::vector<int32_t>> FinishedFrames(const job::JobId& job) override {
    return Call("FinishedFrames", [&] { return store_->FinishedFrames(job); });
  }
  absl::StatusOr<std::vector<std::string>> DeliverersOf(const job::JobId& job) override {
    return Call("DeliverersOf", [&] { return store_->DeliverersOf(job); });
  }
  absl::Status EndJob(const ledger::OwnedJob& job, const ledger::JobEnd& end) override {
    return Call("EndJob", [&] { return store_->EndJob(job, end); });
  }
  ledger::DeliveryQueue& deliveries() override { return store_->deliveries(); }
  absl::Status ReopenFrames(const job::JobId& job, const ledger::Owner& owner,
                            const ledger::Reopening& reopening) override {
    return Call("ReopenFrames", [&] { return store_->ReopenFrames(job, owner, reopening); });
  }
  absl::Status SetScheduling(const ledger::OwnedJob& job, const v1::Scheduling& scheduling) override {
    return Call("SetScheduling", [&] { return store_->SetScheduling(job, scheduling); });
  }
  absl::Status SetPlan(const ledger::OwnedJob& job, const v1::JobSpec& planned) override {
    return Call("SetPlan", [&] { return store_->SetPlan(job, planned); });
  }
  absl::Status DeleteJob(const job::JobId& job) override {
    return Call("DeleteJob", [&] { return store_->DeleteJob(job); });
  }
  absl::StatusOr<int64_t> PurgeUnits(int64_t max_rows) override {
    return Call("PurgeUnits", [&] { return store_->PurgeUnits(max_rows); });
  }
  absl::Status BlockWorker(const std::string& name, const std::string& reason) override {
    return Call("BlockWorker", [&] { return store_->BlockWorker(name, reason); });
  }
  absl::Status ReadmitWorker(const std::string& name) override {
    return Call("ReadmitWorker", [&] { return store_->ReadmitWorker(name); });
  }
  absl::StatusOr<std::vector<ledger::BlockedWorker>> BlockedWorkers() override {
    return Call("BlockedWorkers", [&] { return store_->BlockedWorkers(); });
  }

 protected:
  virtual absl::Status Before(const std::string& call) = 0;

 private:
  template <typename Function>
  auto Call(const char* name, const Function& function) -> decltype(function()) {
    if (absl::Status status = Before(name); !status.ok()) return status;
    return function();
  }

  const std::unique_ptr<ledger::JobStore> store_;
};

/// Lets some calls fail while told to.
class FailingStore final : public StoreWrapper {
 public:
  /// Which call fails, "" for none; shared with the test.
  struct Fault {
    absl::Mutex mutex;
    std::string call ABSL_GUARDED_BY(mutex);
    absl::Status error ABSL_GUARDED_BY(mutex) = absl::UnavailableError("database or disk is full");
    int failures ABSL_GUARDED_BY(mutex) = 0;

    void Set(const std::string& name) {
      absl::MutexLock lock(&mutex);
      call = name;
    }
    int count() {
      absl::MutexLock lock(&mutex);
      return failures;
    }
  };

  FailingStore(std::unique_ptr<ledger::JobStore> store, Fault* fault)
      : StoreWrapper(std::move(store)), fault_(*fault) {}

 private:
  absl::Status Before(const std::string& call) override {
    absl::MutexLock lock(&fault_.mutex);
    if (call != fault_.call) return absl::OkStatus();
    ++fault_.failures;
    return fault_.error;
  }

  Fault& fault_;
};

}  // namespace lumifold::server
