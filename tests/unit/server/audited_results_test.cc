// Results that workers deliver: a share is made again by others, and who lies is found.
#include <gmock/gmock.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "proto/rpc/monotonic.h"
#include "server/job/job_state.h"
#include "server/picture/make_picture.h"
#include "tests/unit/server/coordinator_fixture.h"
#include "tests/unit/server/gated_finisher.h"

namespace lumifold::server {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

class AuditedResultsTest : public CoordinatorFixture {
 protected:
  /// The coordinator has no place: a frame of another job is behind the gate. All frames are audited.
  AuditedResultsTest() {
    make_finisher_ = [this] {
      auto gated =
          std::make_unique<GatedFinisher>(MakeInProcessFinisher(data_, store_.get(), rpc::MonotonicNow));
      gate_ = gated.get();
      return gated;
    };
    EXPECT_TRUE(Start().ok());
    ann_ = std::make_unique<PumpedWorker>(coordinator_.get(), 4, "ann");
    ben_ = std::make_unique<PumpedWorker>(coordinator_.get(), 4, "ben");
    other_ = Submit(Spec(2), "other");
    Render(other_);
    Await([&] { return coordinator_->jobs().GetJob(other_.value())->frames_filtering() == 1; });
    scheduling_.set_audit_share(1);
    job_ = Submit(Spec(2), "audited");
  }

  /// Until all units are committed and compared.
  void Render(const job::JobId& job) {
    Await([&] {
      ann_->Deliver();
      ben_->Deliver();
      return coordinator_->jobs().GetJob(job.value())->state() == v1::JOB_STATE_FILTERING;
    });
  }
  std::unique_ptr<PumpedWorker> Finisher(const std::string& name) {
    return std::make_unique<PumpedWorker>(coordinator_.get(), name);
  }
  static void AwaitLease(const PumpedWorker& worker) {
    Await([&] { return worker.leases() > 0; });
  }
  bool IsDone(const job::JobId& job) const {
    return job::HasEnded(coordinator_->jobs().GetJob(job.value())->state());
  }
  std::vector<std::string> Blocked() {
    std::vector<std::string> names;
    const std::vector<ledger::BlockedWorker> blocked = *store_->BlockedWorkers();
    for (const ledger::BlockedWorker& worker : blocked) names.push_back(worker.name);
    return names;
  }

  GatedFinisher* gate_ = nullptr;
  std::unique_ptr<PumpedWorker> ann_;
  std::unique_ptr<PumpedWorker> ben_;
  job::JobId other_;
  job::JobId job_;
};

TEST_F(AuditedResultsTest, TwoWorkersThatMakeTheSameFinishTheFrame) {
  Render(job_);
  const auto carl = Finisher("carl");
  AwaitLease(*carl);
  ASSERT_TRUE(carl->DeliverResult(coordinator_.get(), "a picture").ok());
  EXPECT_FALSE(IsDone(job_)) << "it is one worker's word";
  absl::SleepFor(absl::Milliseconds(20));
  EXPECT_EQ(carl->leases(), 0) << "it may not confirm itself";
  const auto dora = Finisher("dora");
  AwaitLease(*dora);
  ASSERT_TRUE(dora->DeliverResult(coordinator_.get(), "a picture").ok());
  Await([&] { return IsDone(job_); });
  EXPECT_EQ(Result(job_), "a picture");
  EXPECT_THAT(Blocked(), IsEmpty());
}

TEST_F(AuditedResultsTest, AResultThatIsNotWhatWasPromisedIsRefused) {
  scheduling_.set_audit_share(0);
  const job::JobId job = Submit(Spec(2), "not audited");
  Render(job);
  const auto carl = Finisher("carl");
  AwaitLease(*carl);
  EXPECT_EQ(carl->DeliverResult(coordinator_.get(), "a picture", /*promised=*/"another").code(),
            absl::StatusCode::kDataLoss);
  EXPECT_FALSE(IsDone(job));
}

TEST_F(AuditedResultsTest, WhereTwoDifferTheCoordinatorSaysWhoLied) {
  Render(job_);
  const auto carl = Finisher("carl");
  const auto dora = Finisher("dora");
  AwaitLease(*carl);
  ASSERT_TRUE(carl->DeliverResult(coordinator_.get(), "a lie").ok());
  AwaitLease(*dora);
  ASSERT_TRUE(dora->DeliverResult(coordinator_.get(), "another lie").ok());
  EXPECT_FALSE(IsDone(job_));
  gate_->Open();
  Await([&] { return IsDone(job_) && IsDone(other_); });
  EXPECT_EQ(Result(job_), Result(other_)) << "the same units";
  Await([&] { return Blocked().size() == 2; });
  EXPECT_THAT(Blocked(), ElementsAre("carl", "dora"));
}

TEST_F(AuditedResultsTest, WhoLiesAboutABlockIsFound) {
  ASSERT_TRUE(Cancel(job_).ok());
  v1::JobSpec spec = Spec(513);  // four blocks
  spec.set_tile_size(64);
  const job::JobId wide = Submit(spec, "wide");
  Render(wide);
  const FrameBlocks blocks(spec);
  const auto carl = Finisher("carl");
  const auto dora = Finisher("dora");
  int delivered = 0;
  Await([&] {
    for (PumpedWorker* const worker : {carl.get(), dora.get()}) {
      if (worker->leases() == 0) continue;
      const auto bytes = static_cast<size_t>(blocks.PictureBytes(worker->next().key.tile));
      const std::string picture(bytes, worker == carl.get() ? 'c' : 'd');
      EXPECT_TRUE(worker->DeliverResult(coordinator_.get(), picture).ok());
      ++delivered;
    }
    return delivered == 2 * blocks.count();
  });
  EXPECT_FALSE(IsDone(wide));
  gate_->Open();
  Await([&] { return IsDone(wide); });
  Await([&] { return Blocked().size() == 2; });
  EXPECT_THAT(Blocked(), ElementsAre("carl", "dora"));
  scheduling_.set_audit_share(0);
  const job::JobId alone = Submit(spec, "alone");
  Render(alone);
  Await([&] { return IsDone(alone); });
  EXPECT_TRUE(Result(wide) == Result(alone));
}

TEST_F(AuditedResultsTest, WithoutAnotherWorkerTheCoordinatorComparesItself) {
  Render(job_);
  const auto carl = Finisher("carl");
  AwaitLease(*carl);
  gate_->Open();
  Await([&] { return IsDone(other_); });
  ASSERT_TRUE(carl->DeliverResult(coordinator_.get(), Result(other_)).ok());
  Await([&] { return IsDone(job_); });
  EXPECT_EQ(Result(job_), Result(other_));
  EXPECT_THAT(Blocked(), IsEmpty());
}

}  // namespace
}  // namespace lumifold::server
