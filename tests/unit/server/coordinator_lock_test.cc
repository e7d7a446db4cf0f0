// The coordinator's lock is free during every call of the ledger and of a file.
#include <condition_variable>
#include <mutex>
#include <thread>

#include "absl/time/clock.h"
#include "tests/unit/server/coordinator_fixture.h"
#include "tests/unit/server/store_wrapper.h"

namespace lumifold::server {
namespace {

/// Takes the coordinator's lock on a thread of its own while another thread is inside a call: that ends only
/// if the caller does not hold the lock.
class LockProbe {
 public:
  LockProbe() : thread_([this] { Run(); }) {}
  ~LockProbe() {
    {
      const std::lock_guard lock(mutex_);
      ending_ = true;
    }
    changed_.notify_all();
    thread_.join();
  }

  void Use(Coordinator* coordinator) {
    const std::lock_guard lock(mutex_);
    coordinator_ = coordinator;
  }

  void Check(const std::string& call) {
    std::unique_lock lock(mutex_);
    if (coordinator_ == nullptr) return;
    const int64_t number = ++asked_;
    changed_.notify_all();
    const bool is_free =
        changed_.wait_for(lock, std::chrono::minutes(5), [&] { return answered_ >= number; });
    EXPECT_TRUE(is_free) << "the coordinator's lock is held during " << call;
    calls_.insert(call);
  }

  std::set<std::string> calls() {
    const std::lock_guard lock(mutex_);
    return calls_;
  }

 private:
  void Run() {
    std::unique_lock lock(mutex_);
    while (true) {
      changed_.wait(lock, [this] { return ending_ || answered_ < asked_; });
      if (ending_) return;
      const int64_t number = asked_;
      Coordinator* const coordinator = coordinator_;
      lock.unlock();
      if (coordinator != nullptr)
        coordinator->workers().FindLease(job::WorkerId(0), {}, job::Attempt(0));  // takes the lock
      lock.lock();
      answered_ = std::max(answered_, number);
      changed_.notify_all();
    }
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  Coordinator* coordinator_ = nullptr;
  int64_t asked_ = 0;
  int64_t answered_ = 0;
  std::set<std::string> calls_;
  bool ending_ = false;
  std::thread thread_;
};

class ProbingStore final : public StoreWrapper {
 public:
  ProbingStore(std::unique_ptr<ledger::JobStore> store, LockProbe* probe)
      : StoreWrapper(std::move(store)), probe_(*probe) {}

 private:
  absl::Status Before(const std::string& call) override {
    probe_.Check(call);
    return absl::OkStatus();
  }

  LockProbe& probe_;
};

class NullWatcher final : public JobWatcher {
 public:
  void OnStatus(const v1::JobStatus&) override {}
  void OnLost(const absl::Status&) override {}
};

class CoordinatorLockTest : public CoordinatorFixture {
 protected:
  CoordinatorLockTest() {
    wrap_store_ = [this](std::unique_ptr<ledger::JobStore> store) {
      return std::make_unique<ProbingStore>(std::move(store), &probe_);
    };
    files_.OnCall([this](const std::string&) { probe_.Check("a file"); });
  }

  LockProbe probe_;
};

TEST_F(CoordinatorLockTest, IsFreeDuringEveryCallOfTheLedgerAndOfAFile) {
  ASSERT_TRUE(Start().ok());
  probe_.Use(coordinator_.get());
  const job::JobId job = Submit(Spec(2), "done");
  const job::JobId cancelled = Submit(Spec(2), "cancelled");
  NullWatcher watcher;
  ASSERT_TRUE(coordinator_->jobs().Watch(job.value(), &watcher).ok());
  {
    PumpedWorker worker(coordinator_.get(), 2);
    worker.Deliver(1);
    coordinator_->changes().CancelJob(cancelled.value(), [](const absl::StatusOr<v1::JobStatus>&) {});
    EXPECT_EQ(Finish(job, &worker).state(), v1::JOB_STATE_DONE);
    EXPECT_EQ(Finish(cancelled, &worker).state(), v1::JOB_STATE_CANCELLED);
  }
  coordinator_->jobs().Unwatch(&watcher);
  EXPECT_TRUE(coordinator_->jobs().Watch(job.value(), &watcher).ok());
  coordinator_->jobs().Unwatch(&watcher);
  EXPECT_TRUE(coordinator_->jobs().GetJob(cancelled.value()).ok());
  EXPECT_EQ(coordinator_->jobs().ListJobs({})->jobs_size(), 2);
  EXPECT_TRUE(coordinator_->jobs().GetServerStatus().ok());
  v1::DownloadResultRequest download;
  download.set_job_id(job.value());
  EXPECT_TRUE(coordinator_->jobs().OpenResult(download).ok());
  coordinator_->Shutdown();
  for (const char* call : {"CreateJob", "CommitUnits", "RecordFrame", "EndJob", "GetJob", "ListJobs",
                           "FinishedFrames", "ForEachUnit", "a file"}) {
    EXPECT_TRUE(probe_.calls().contains(call)) << call << " was not made";
  }
  probe_.Use(nullptr);
}

}  // namespace
}  // namespace lumifold::server
