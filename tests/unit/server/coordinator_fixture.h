#pragma once

#include <gtest/gtest.h>

#include <deque>
#include <filesystem>
#include <memory>
#include <optional>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "absl/synchronization/mutex.h"
#include "server/access/identity.h"
#include "server/assets/asset_store.h"
#include "server/coordinator/coordinator.h"
#include "server/finish/frame_finisher.h"
#include "server/services/worker_session.h"
#include "tests/support/temp_folder.h"
#include "tests/unit/server/faulty_files.h"

namespace lumifold::server {

/// A worker without a connection: it delivers RandomUnit, or MadeUpPlan, for its leases when it is told to.
class PumpedWorker final : public WorkerSink {
 public:
  /// The coordinator must outlive it. Workers with equal seeds deliver equal pixels. `caller`: whose
  /// connection it is.
  PumpedWorker(Coordinator* coordinator, int slots, const std::string& name = "pumped", uint32_t seed = 1,
               const access::Identity& caller = access::LocalIdentity());
  /// A connection of the process with this number. An earlier one may still be open.
  PumpedWorker(Coordinator* coordinator, int slots, uint64_t instance);
  /// One that finishes a frame at a time, and renders nothing.
  PumpedWorker(Coordinator* coordinator, const std::string& name);
  /// One that says this of itself, beside its class.
  PumpedWorker(Coordinator* coordinator, const v1::Hello& hello);

  void Send(const v1::CoordinatorMessage& message) override;
  /// Delivers the units of at most `count` leases that it has got; returns how many.
  int Deliver(int count = 1'000'000);
  int leases() const;
  /// The unit that it delivers next.
  job::UnitRef next() const;
  /// Where it was sent to.
  std::string move_address() const;
  /// Units that were acknowledged.
  std::set<job::UnitRef> acknowledged() const;
  /// Delivers this for the first lease that it has got, which is of a plan unit.
  void DeliverPlan(const v1::Plan& plan);
  /// Delivers pixels for the first lease that it has got.
  void DeliverPixels();
  /// Delivers these bytes for the frame that it has a lease to finish; `promised` are those of its SHA-256.
  absl::Status DeliverResult(Coordinator* coordinator, const std::string& bytes) {
    return DeliverResult(coordinator, bytes, /*promised=*/bytes);
  }
  absl::Status DeliverResult(Coordinator* coordinator, const std::string& bytes, const std::string& promised);
  /// Says that it cannot render the units of at most `count` leases that it has got.
  void Fail(int count = 1'000'000);
  /// All units that were ever leased to it.
  std::set<job::UnitRef> leased() const;

 private:
  v1::Lease TakeLease();
  void DeliverUnit(const v1::Lease& lease);
  void DeliverPixels(const v1::Lease& lease);
  void DeliverPlan(const v1::Lease& lease, const v1::Plan& plan);

  void Open(Coordinator* coordinator, v1::Hello hello, const access::Identity& caller);

  const uint32_t seed_;
  mutable absl::Mutex mutex_;
  std::deque<v1::Lease> leases_ ABSL_GUARDED_BY(mutex_);
  std::set<job::UnitRef> leased_ ABSL_GUARDED_BY(mutex_);
  std::set<job::UnitRef> acknowledged_ ABSL_GUARDED_BY(mutex_);
  std::string move_address_ ABSL_GUARDED_BY(mutex_);
  std::string id_ ABSL_GUARDED_BY(mutex_);  // of Welcome
  std::unique_ptr<WorkerSession> session_;  // last: it uses the members above
};

/// A coordinator without gRPC over faulty files, and a client's calls. It retries at once, and storage that
/// cannot be written is tried every millisecond.
class CoordinatorFixture : public ::testing::Test {
 protected:
  CoordinatorFixture() : data_(folder_.PathOf("data"), &files_) {}

  /// Starts a coordinator over the data folder. Errors: as Server::Start.
  absl::Status Start();
  /// Ends it; as after a crash, workers do not learn of it.
  void Stop();
  /// Uploads the scene and submits the job; repeats what failed for the storage.
  job::JobId Submit(const v1::JobSpec& spec, const std::string& request_id = "request-1");
  /// One try.
  absl::StatusOr<job::JobId> TrySubmit(const v1::JobSpec& spec, const std::string& request_id = "request-1");
  /// Lets the worker deliver until the job has ended; its status.
  v1::JobStatus Finish(const job::JobId& job, PumpedWorker* worker);
  /// Asks to cancel the job and waits for the answer.
  absl::Status Cancel(const job::JobId& job);
  /// Waits until `condition` holds.
  static void Await(const std::function<bool()>& condition);
  /// Lets the worker deliver the units of `count` leases, which may still be on their way to it.
  static void Deliver(PumpedWorker* worker, int count);

  /// A job of `tiles` tiles of 8 pixels in a row, each with one geometry unit and one pass.
  v1::JobSpec Spec(int tiles = 1) const;
  /// The same, but with a plan unit first: PumpedWorker plans these units.
  v1::JobSpec UnplannedSpec(int tiles = 1) const;
  std::string Result(const job::JobId& job, int32_t frame = 0) const;

  /// In memory where the machine has such a folder: what these tests sync they sync thousands of times.
  static std::filesystem::path Parent() {
    const std::filesystem::path memory = "/dev/shm";
    return std::filesystem::is_directory(memory) ? memory : std::filesystem::temp_directory_path();
  }

  TempFolder folder_{Parent()};
  FaultyFiles files_;
  DataFolder data_;
  CoordinatorOptions options_;
  /// Makes the store that the coordinator uses out of the real one.
  std::function<std::unique_ptr<ledger::JobStore>(std::unique_ptr<ledger::JobStore>)> wrap_store_;
  /// Replaces the finisher that filters in this process.
  std::function<std::unique_ptr<FrameFinisher>()> make_finisher_;
  /// Of the jobs that are submitted.
  v1::Scheduling scheduling_;

  rpc::FileHandle lock_;
  uint64_t random_ = 0;
  std::ostringstream log_;  // read it after Stop
  std::unique_ptr<ledger::JobStore> store_;
  std::unique_ptr<AssetStore> assets_;
  std::unique_ptr<FrameFinisher> finisher_;
  std::unique_ptr<Coordinator> coordinator_;
};

}  // namespace lumifold::server
