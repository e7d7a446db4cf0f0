// Frames of which a worker keeps the units until it delivers their files.
#include <gmock/gmock.h>

#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "proto/rpc/monotonic.h"
#include "server/job/job_state.h"
#include "server/storage/folder_contents.h"
#include "tests/unit/server/coordinator_fixture.h"
#include "tests/unit/server/gated_finisher.h"

namespace lumifold::server {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

class KeptFramesTest : public CoordinatorFixture {
 protected:
  /// The coordinator finishes nothing before its gate is opened, and keeps no film.
  KeptFramesTest() {
    make_finisher_ = [this] {
      auto gated =
          std::make_unique<GatedFinisher>(MakeInProcessFinisher(data_, store_.get(), rpc::MonotonicNow));
      gate_ = gated.get();
      return gated;
    };
    options_.retention.film_bytes = 0;
    EXPECT_TRUE(Start().ok());
    v1::JobSpec spec = Spec(2);
    spec.set_frame_count(kFrames);
    job_ = Submit(spec);
  }

  std::unique_ptr<PumpedWorker> Keeper(const std::string& name = "ann") {
    v1::Hello hello;
    hello.set_name(name);
    hello.set_slots(1);
    hello.set_finishes(1);
    hello.set_finish_memory_bytes(uint64_t{1} << 40);
    hello.set_keep_bytes(uint64_t{1} << 40);
    return std::make_unique<PumpedWorker>(coordinator_.get(), hello);
  }
  v1::JobStatus Status() const { return *coordinator_->jobs().GetJob(job_.value()); }
  /// The worker delivers the next of what it has leases for.
  void Work(PumpedWorker* worker) {
    if (worker->leases() == 0) return;
    if (worker->next().key.kind != v1::UNIT_KIND_RESULT) {
      worker->Deliver(1);
      return;
    }
    const std::string picture = absl::StrCat("picture ", worker->next().key.frame);
    EXPECT_TRUE(worker->DeliverResult(coordinator_.get(), picture).ok());
  }
  /// Until it is to deliver the file of a kept frame: of the first one that is not in the coordinator's log.
  void WorkUntilDue(PumpedWorker* worker) {
    Await([&] {
      if (worker->leases() > 0 && worker->next().key.kind == v1::UNIT_KIND_RESULT &&
          LogOf(worker->next().key.frame).empty())
        return true;
      Work(worker);
      return false;
    });
  }
  std::vector<UnitLogFile> LogOf(int32_t frame) const { return UnitLogsOf(data_, job_, frame); }
  void FinishJob(PumpedWorker* worker) {
    gate_->Open();
    Await([&] {
      Work(worker);
      return job::HasEnded(Status().state());
    });
    const v1::JobStatus status = Status();
    EXPECT_EQ(status.state(), v1::JOB_STATE_DONE) << status.error();
    EXPECT_EQ(status.units_done(), status.units_total());
    EXPECT_EQ(store_->GetJob(job_)->done.units, status.units_total()) << "each once";
    EXPECT_EQ(store_->GetJob(job_)->done.frames, kFrames);
  }

  static constexpr int kFrames = 12;
  GatedFinisher* gate_ = nullptr;
  job::JobId job_;
};

TEST_F(KeptFramesTest, AreRecordedWithTheirFiles) {
  auto ann = Keeper();
  WorkUntilDue(ann.get());
  const int32_t frame = ann->next().key.frame;
  const int64_t recorded = store_->GetJob(job_)->done.units;
  EXPECT_GT(Status().units_done(), recorded) << "they count at once";
  Work(ann.get());
  Await([&] { return store_->GetJob(job_)->done.units >= recorded + 4; });
  EXPECT_EQ(Result(job_, frame), absl::StrCat("picture ", frame));
  FinishJob(ann.get());
  ann.reset();
  Stop();
  EXPECT_THAT(log_.str(), Not(HasSubstr("event=frame_kept_no_more")));
}

TEST_F(KeptFramesTest, AreRenderedAgainWithoutTheirKeeper) {
  auto ann = Keeper();
  WorkUntilDue(ann.get());
  const int64_t done = Status().units_done();
  ann.reset();
  EXPECT_LT(Status().units_done(), done);
  auto ben = Keeper("ben");
  FinishJob(ben.get());
  ben.reset();
  Stop();
  EXPECT_THAT(log_.str(), HasSubstr("event=frame_kept_no_more"));
}

TEST_F(KeptFramesTest, AWorkerThatCannotFinishOneKeepsNoMore) {
  auto ann = Keeper();
  WorkUntilDue(ann.get());
  ann->Fail(1);
  FinishJob(ann.get());
  ann.reset();
  Stop();
  const std::vector<std::string> kept = absl::StrSplit(log_.str(), "kept=true");
  EXPECT_GE(kept.size(), 2u);
  EXPECT_LE(kept.size(), 3u) << "and one that it had begun";
}

TEST_F(KeptFramesTest, ARestartRendersThemAgain) {
  auto ann = Keeper();
  WorkUntilDue(ann.get());
  ann.reset();
  Stop();
  ASSERT_TRUE(Start().ok());
  const auto ben = Keeper("ben");
  FinishJob(ben.get());
}

}  // namespace
}  // namespace lumifold::server
