// One small job, with a fault at every single call that changes a file, in turn: the picture is right after
// each, and nothing that was acknowledged is lost. The schedule is enumerated until the job ends without
// reaching the fault.
#include <cerrno>
#include <filesystem>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "tests/unit/server/coordinator_fixture.h"

namespace lumifold::server {
namespace {

class FaultEnumerationTest : public CoordinatorFixture {
 protected:
  /// Starts, submits and renders until the job is done or the machine stops. Adds acknowledged units to
  /// `acknowledged_`, none of which may be leased again.
  void RenderUntilDoneOrStopped() {
    while (!Start().ok()) {
      Stop();
      if (files_.has_stopped()) return;
    }
    job_ = Submit(UnplannedSpec(2));
    if (files_.has_stopped()) return Stop();
    {
      PumpedWorker worker(coordinator_.get(), 2);
      const v1::JobStatus status = Finish(job_, &worker);
      EXPECT_TRUE(files_.has_stopped() || status.state() == v1::JOB_STATE_DONE) << status.error();
      for (const job::UnitRef& unit : acknowledged_)
        EXPECT_FALSE(worker.leased().contains(unit)) << Describe(unit);
      acknowledged_.merge(worker.acknowledged());
      coordinator_->Shutdown();
    }
    Stop();
  }

  /// Runs the job with a new data folder. Returns whether the fault was reached.
  bool Run(int64_t call, bool loses_unsynced, const std::function<void()>& set_fault) {
    acknowledged_.clear();
    std::filesystem::remove_all(data_.root());
    files_.Restart(/*loses_unsynced=*/false);
    first_call_ = files_.calls();
    set_fault();
    RenderUntilDoneOrStopped();
    const bool reached = files_.calls() - first_call_ >= call;
    if (files_.has_stopped()) {
      files_.Restart(loses_unsynced);
      RenderUntilDoneOrStopped();
    }
    const std::string result = Result(job_);
    if (expected_.empty()) expected_ = result;
    EXPECT_FALSE(result.empty());
    EXPECT_EQ(result, expected_);
    return reached;
  }

  void EnumerateErrors(int error) {
    for (int64_t call = 1;; ++call) {
      SCOPED_TRACE(absl::StrCat("error ", error, " at call ", call));
      if (!Run(call, false, [&] { files_.FailAt(first_call_ + call, error); })) break;
      if (HasFailure()) break;
    }
  }

  void EnumerateStops(bool loses_unsynced) {
    for (int64_t call = 1;; ++call) {
      SCOPED_TRACE(absl::StrCat("stop at call ", call));
      if (!Run(call, loses_unsynced, [&] { files_.StopAt(first_call_ + call); })) break;
      if (HasFailure()) break;
    }
  }

  int64_t first_call_ = 0;
  job::JobId job_;
  std::set<job::UnitRef> acknowledged_;
  std::string expected_;
};

TEST_F(FaultEnumerationTest, ADiskThatIsFullForOneCall) { EnumerateErrors(ENOSPC); }
TEST_F(FaultEnumerationTest, ADiskThatFailsForOneCall) { EnumerateErrors(EIO); }
TEST_F(FaultEnumerationTest, NoDescriptorForOneCall) { EnumerateErrors(EMFILE); }
TEST_F(FaultEnumerationTest, AMachineThatStopsAndForgetsWhatWasNotSynced) { EnumerateStops(true); }
TEST_F(FaultEnumerationTest, AMachineThatStopsAndTearsTheLastWrite) { EnumerateStops(false); }

}  // namespace
}  // namespace lumifold::server
