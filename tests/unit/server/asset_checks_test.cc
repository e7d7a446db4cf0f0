#include "server/assets/asset_checks.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/synchronization/notification.h"
#include "proto/rpc/sha256.h"
#include "tests/support/temp_folder.h"
#include "tests/unit/server/farm_fixture.h"

namespace lumifold::server {
namespace {

/// An asset whose check takes until Release: a pipe, so that opening it waits for a writer.
class SlowAsset {
 public:
  SlowAsset(const std::string& folder, int number)
      : sha256_(rpc::Sha256Hex(absl::StrCat("slow ", number))), path_(folder + "/" + sha256_) {
    EXPECT_EQ(mkfifo(path_.c_str(), 0600), 0);
  }
  const std::string& sha256() const { return sha256_; }
  /// Waits for the check to begin. From then on it is a file with another content than its name says.
  void Release() const {
    const int fd = open(path_.c_str(), O_WRONLY);
    const std::string file = path_ + ".file";
    std::ofstream(file) << "wrong";
    std::filesystem::rename(file, path_);
    close(fd);
  }

 private:
  std::string sha256_;
  std::string path_;
};

class AssetChecksTest : public ::testing::Test {
 protected:
  AssetChecksTest() {
    for (const char* name : {"assets", "incoming"}) std::filesystem::create_directory(folder_.PathOf(name));
    store_ = std::make_unique<AssetStore>(folder_.PathOf("assets"), folder_.PathOf("incoming"));
  }
  std::string Store(const std::string& content) const {
    const std::string sha256 = rpc::Sha256Hex(content);
    std::ofstream(folder_.PathOf("assets/" + sha256)) << content;
    return sha256;
  }

  TempFolder folder_;
  std::unique_ptr<AssetStore> store_;
};

TEST_F(AssetChecksTest, OneThatTakesLongDelaysNoOther) {
  const SlowAsset slow(folder_.PathOf("assets"), 1);
  const std::string oak = Store("oak");
  const std::string elm = Store("elm");
  AssetChecks checks(store_.get());
  absl::Notification slow_done;
  absl::Notification quick_done;
  checks.Check({slow.sha256(), oak}, [&](const absl::Status& status) {
    EXPECT_TRUE(status.ok());
    slow_done.Notify();
  });
  checks.Check({oak, elm}, [&](const absl::Status& status) {
    EXPECT_TRUE(status.ok());
    EXPECT_FALSE(store_->NeedsCheck(oak));
    EXPECT_TRUE(store_->Has(elm));
    quick_done.Notify();
  });
  quick_done.WaitForNotification();
  EXPECT_FALSE(slow_done.HasBeenNotified());
  slow.Release();
  slow_done.WaitForNotification();
  EXPECT_FALSE(store_->Has(slow.sha256()));
}

TEST_F(AssetChecksTest, WhatIsCheckedOrNotThereIsAnsweredAtOnce) {
  const std::string oak = Store("oak");
  EXPECT_TRUE(store_->Has(oak));
  AssetChecks checks(store_.get());
  bool done = false;
  checks.Check({oak, std::string(64, '0'), "../../etc/passwd", ""},
               [&](const absl::Status&) { done = true; });
  EXPECT_TRUE(done);
}

TEST_F(AssetChecksTest, AnAssetInDoubtIsReadAgain) {
  const std::string oak = Store("oak");
  EXPECT_TRUE(store_->Has(oak));
  std::ofstream(folder_.PathOf("assets/" + oak)) << "ook";
  EXPECT_TRUE(store_->Has(oak)) << "it was checked before";
  AssetChecks checks(store_.get());
  absl::Notification done;
  checks.Recheck(oak, [&](const absl::Status&) { done.Notify(); });
  done.WaitForNotification();
  EXPECT_FALSE(store_->Has(oak));
}

TEST_F(AssetChecksTest, StopAnswersAllThatWait) {
  std::vector<std::unique_ptr<SlowAsset>> slow;
  AssetChecks checks(store_.get());
  std::atomic<int> stopped = 0;
  for (int i = 0; i < 9; ++i) {
    slow.push_back(std::make_unique<SlowAsset>(folder_.PathOf("assets"), i));
    checks.Check({slow.back()->sha256()}, [&](const absl::Status& s) { stopped += absl::IsUnavailable(s); });
  }
  std::atomic<bool> is_over = false;
  std::thread release([&] {  // those that are being read; the others have no reader, so that the call fails
    while (stopped < 9) std::this_thread::yield();
    while (!is_over) {
      for (const auto& asset : slow) {
        const int fd = open(folder_.PathOf("assets/" + asset->sha256()).c_str(), O_WRONLY | O_NONBLOCK);
        if (fd >= 0) close(fd);
      }
    }
  });
  checks.Stop();
  is_over = true;
  release.join();
  EXPECT_EQ(stopped, 9);
  bool done = false;
  checks.Check({Store("oak")}, [&](const absl::Status& s) { done = absl::IsUnavailable(s); });
  EXPECT_TRUE(done);
}

class AssetCallsTest : public FarmFixture {
 protected:
  grpc::Status Find(const std::string& sha256) const {
    grpc::ClientContext context;
    v1::FindMissingAssetsRequest request;
    request.add_assets()->set_sha256(sha256);
    v1::FindMissingAssetsResponse response;
    return v1::FarmService::NewStub(Channel())->FindMissingAssets(&context, request, &response);
  }
  std::vector<std::string> Reasons(const std::string& job) const {
    grpc::ClientContext context;
    v1::ExplainJobRequest request;
    request.set_job_id(job);
    v1::ExplainJobResponse response;
    EXPECT_TRUE(v1::FarmService::NewStub(Channel())->ExplainJob(&context, request, &response).ok());
    std::vector<std::string> reasons;
    for (const v1::Reason& reason : response.reasons())
      reasons.push_back(absl::StrCat(reason.code(), ": ", reason.text()));
    return reasons;
  }
};

TEST_F(AssetCallsTest, TheCheckOfALargeAssetHoldsUpNoOtherCall) {
  const std::string job = *Submit(Spec());
  const SlowAsset slow(folder_.PathOf("data/assets"), 1);
  std::vector<std::thread> callers;  // more than gRPC has threads
  for (int i = 0; i < 64; ++i) callers.emplace_back([&] { EXPECT_TRUE(Find(slow.sha256()).ok()); });
  for (int i = 0; i < 100; ++i) EXPECT_EQ(Get(job)->job_id(), job);
  slow.Release();
  for (std::thread& caller : callers) caller.join();
}

/// A worker that reports the scene of each unit as missing while `is_missing`.
std::unique_ptr<FakeWorker> SceneReader(const std::shared_ptr<grpc::Channel>& channel,
                                        const std::string& sha256, std::atomic<bool>* is_missing) {
  return std::make_unique<FakeWorker>(
      channel, FakeWorkerOptions{.spoil = [sha256, is_missing](v1::WorkerMessage& message) {
        if (!message.has_chunk() || !*is_missing) return;
        v1::UnitFailure failure;
        *failure.mutable_unit() = message.chunk().unit();
        failure.set_attempt(message.chunk().attempt());
        failure.set_error("no such asset");
        failure.mutable_missing_asset()->set_sha256(sha256);
        *message.mutable_failure() = failure;
      }});
}

TEST_F(AssetCallsTest, AJobWaitsForAnAssetThatIsLostAndGoesOnWhenItIsUploadedAgain) {
  const v1::JobSpec spec = Spec();
  const std::string sha256 = spec.scene().file().sha256();
  const std::string job = *Submit(spec);
  const std::string path = folder_.PathOf("data/assets/" + sha256);
  for (const bool damaged : {true, false}) {
    std::atomic<bool> is_missing = true;
    const std::string waiting = *Submit(Spec(), absl::StrCat("waits ", damaged));
    if (damaged) {
      std::fstream(path, std::ios::in | std::ios::out).put('!');
    } else {
      std::filesystem::remove(path);
    }
    const auto worker = SceneReader(Channel(), sha256, &is_missing);
    std::vector<std::string> reasons;
    while (reasons.empty() || !reasons[0].starts_with("asset: the scene file (" + sha256)) {
      reasons = Reasons(waiting);
      std::this_thread::yield();
    }
    EXPECT_EQ(Get(waiting)->state(), v1::JOB_STATE_PLANNED);
    is_missing = false;
    Spec();  // uploads it
    EXPECT_EQ(WaitForEnd(waiting).state(), v1::JOB_STATE_DONE);
  }
  EXPECT_EQ(WaitForEnd(job).state(), v1::JOB_STATE_DONE);
}

TEST_F(AssetCallsTest, AWorkerThatCannotReadAnIntactAssetHasFailed) {
  RestartForOneWorker();
  const std::string job = *Submit(Spec());
  std::atomic<bool> is_missing = true;
  const auto worker = SceneReader(Channel(), Spec().scene().file().sha256(), &is_missing);
  const v1::JobStatus status = WaitForEnd(job);
  EXPECT_EQ(status.state(), v1::JOB_STATE_FAILED);
  EXPECT_EQ(status.error(), "no such asset");
}

}  // namespace
}  // namespace lumifold::server
