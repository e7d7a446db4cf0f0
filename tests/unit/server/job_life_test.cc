// What happens to jobs after their submission: they wait for others, get more samples, are rendered again,
// deleted.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "proto/rpc/checksum.h"
#include "proto/rpc/sha256.h"
#include "proto/rpc/status_codec.h"
#include "server/coordinator/job_status.h"
#include "server/job/limits.h"
#include "server/limits.h"
#include "tests/unit/server/farm_fixture.h"

namespace lumifold::server {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

constexpr int kTiles = 6;

class JobLifeTest : public FarmFixture {
 protected:
  absl::StatusOr<std::string> SubmitAfter(const std::vector<std::string>& after,
                                          const std::string& request_id) {
    v1::SubmitJobRequest request;
    *request.mutable_spec() = Spec();
    request.set_request_id(request_id);
    for (const std::string& job : after) request.mutable_scheduling()->add_after(job);
    v1::SubmitJobResponse response;
    const absl::Status status = Call(&v1::FarmService::Stub::SubmitJob, request, &response);
    if (!status.ok()) return status;
    return response.job_id();
  }
  absl::Status AddSamples(const std::string& job, int samples) {
    v1::AddSamplesRequest request;
    request.set_job_id(job);
    request.set_samples_per_pixel(samples);
    v1::JobStatus response;
    return Call(&v1::FarmService::Stub::AddSamples, request, &response);
  }
  absl::Status Retry(
      const std::string& job, const std::function<void(v1::RetryJobRequest&)>& fill = [](auto&) {}) {
    v1::RetryJobRequest request;
    request.set_job_id(job);
    fill(request);
    v1::JobStatus response;
    return Call(&v1::FarmService::Stub::RetryJob, request, &response);
  }
  absl::Status Delete(const std::string& job) {
    v1::DeleteJobRequest request;
    request.set_job_id(job);
    v1::DeleteJobResponse response;
    return Call(&v1::FarmService::Stub::DeleteJob, request, &response);
  }
  absl::Status Cancel(const std::string& job) {
    v1::CancelJobRequest request;
    request.set_job_id(job);
    v1::JobStatus response;
    return Call(&v1::FarmService::Stub::CancelJob, request, &response);
  }

  /// Renders a job to its end with one worker; returns how many units that took.
  int Render(const std::string& job) {
    const auto worker = Worker();
    EXPECT_EQ(WaitForEnd(job).state(), v1::JOB_STATE_DONE) << Get(job)->error();
    return worker->delivered();
  }
  /// A job that is done; its picture is that of RenderUndisturbed.
  std::string DoneJob(const std::string& request_id) {
    std::string job = *Submit(Spec(), request_id);
    EXPECT_EQ(Render(job), kUnits);
    return job;
  }
  /// The picture of a job that was submitted with this number of samples.
  std::string PictureWith(int samples) {
    v1::JobSpec spec = Spec();
    spec.set_samples_per_pixel(samples);
    const std::string job = *Submit(spec, absl::StrCat("with ", samples));
    Render(job);
    return *Download(job, 0);
  }
  /// A job of which about a third is committed.
  std::string BegunJob(const std::string& request_id) {
    std::string job = *Submit(Spec(), request_id);
    const auto victim = Worker({.slots = 1, .vanish_after = 9});
    victim->Wait();
    WaitUntil(job, [](const v1::JobStatus& status) { return status.units_done() >= 8; });
    return job;
  }

  std::string PathIn(const std::string& folder, const std::string& job) const {
    return folder_.PathOf(absl::StrCat("data/", folder, "/", job));
  }
  void RestartWith(const std::function<void(ServerOptions&)>& change) {
    StopServer();
    ServerOptions options = Options();
    change(options);
    StartServer(options);
  }

  template <typename Method, typename Request, typename Response>
  absl::Status Call(Method method, const Request& request, Response* response) {
    grpc::ClientContext context;
    context.set_deadline(absl::ToChronoTime(absl::Now() + kPatience));
    const auto stub = v1::FarmService::NewStub(Channel());
    return rpc::StatusFromGrpc((stub.get()->*method)(&context, request, response));
  }
};

TEST_F(JobLifeTest, AddedSamplesGiveThePictureOfAJobSubmittedWithAsMany) {
  const std::string job = DoneJob("few");
  ASSERT_TRUE(AddSamples(job, 21).ok());
  EXPECT_EQ(Download(job, 0).status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(Get(job)->units_done(), kTiles * 3);  // geometry and two whole passes
  // The third pass had two samples and gets four; three passes are new.
  EXPECT_EQ(Render(job), kTiles * 4);
  EXPECT_EQ(Get(job)->samples_done(), 20 * 12 * 21);
  EXPECT_EQ(*Download(job, 0), PictureWith(21));
}

TEST_F(JobLifeTest, SamplesAreAddedToJobsInAnyState) {
  const std::string expected = PictureWith(14);
  const std::string running = BegunJob("running");
  ASSERT_TRUE(AddSamples(running, 14).ok());
  EXPECT_GE(Get(running)->units_done(), 8);
  EXPECT_LT(Render(running), kTiles * 5);
  EXPECT_EQ(*Download(running, 0), expected);
  const std::string cancelled = BegunJob("cancelled");
  ASSERT_TRUE(Cancel(cancelled).ok());
  ASSERT_TRUE(AddSamples(cancelled, 14).ok());
  EXPECT_LT(Render(cancelled), kTiles * 5);
  EXPECT_EQ(*Download(cancelled, 0), expected);
}

TEST_F(JobLifeTest, SamplesAreAddedWhileAWorkerRenders) {
  const std::string expected = PictureWith(30);
  const std::string job = *Submit(Spec(), "live");
  const auto worker = Worker();
  for (const int samples : {12, 14, 22, 30}) ASSERT_TRUE(AddSamples(job, samples).ok());
  EXPECT_EQ(WaitForEnd(job).state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(*Download(job, 0), expected);
}

TEST_F(JobLifeTest, AddingSamplesAgainHasNoEffectAndFewerAreRefused) {
  const std::string job = DoneJob("few");
  ASSERT_TRUE(AddSamples(job, 10).ok());
  EXPECT_EQ(Get(job)->state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(AddSamples(job, 9).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(AddSamples(job, job::kMaxSamples + 1).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(AddSamples("j-none", 20).code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(Get(job)->state(), v1::JOB_STATE_DONE);
}

TEST_F(JobLifeTest, AReopenedJobSurvivesARestart) {
  const std::string job = DoneJob("few");
  ASSERT_TRUE(AddSamples(job, 21).ok());
  StopServer();
  StartServer();
  EXPECT_EQ(Get(job)->units_done(), kTiles * 3);
  EXPECT_EQ(Render(job), kTiles * 4);
  const std::string picture = *Download(job, 0);
  StopServer();
  StartServer();
  ASSERT_TRUE(AddSamples(job, 25).ok());
  EXPECT_EQ(Render(job), kTiles * 2);
  EXPECT_EQ(picture, PictureWith(21));
  EXPECT_EQ(*Download(job, 0), PictureWith(25));
}

TEST_F(JobLifeTest, WithoutItsFilmAJobIsRenderedAgainWholly) {
  RestartWith([](ServerOptions& options) { options.data.retention.film_bytes = 0; });
  const std::string job = DoneJob("few");
  WaitFor([&] { return !fs::exists(PathIn("film", job)); });
  ASSERT_TRUE(AddSamples(job, 21).ok());
  EXPECT_EQ(Render(job), kTiles * 7);
  EXPECT_EQ(*Download(job, 0), PictureWith(21));
  EXPECT_EQ(Retry(job, [](auto& request) { request.set_filter_only(true); }).code(),
            absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(Get(job)->state(), v1::JOB_STATE_DONE);
}

TEST_F(JobLifeTest, ARegionIsRenderedAgain) {
  const std::string expected = RenderUndisturbed();
  const std::string job = *Submit(Spec(), "undisturbed");
  const auto region = [](v1::RetryJobRequest& request) {
    request.mutable_region()->set_x0(7);
    request.mutable_region()->set_x1(9);
    request.mutable_region()->set_y0(0);
    request.mutable_region()->set_y1(1);
  };
  ASSERT_TRUE(Retry(job, region).ok());
  EXPECT_EQ(Render(job), 2 * 4);  // two tiles, their geometry and three passes
  EXPECT_EQ(*Download(job, 0), expected);
  const auto outside = [](v1::RetryJobRequest& request) { request.mutable_region()->set_x1(-1); };
  EXPECT_EQ(Retry(job, outside).code(), absl::StatusCode::kInvalidArgument);
}

TEST_F(JobLifeTest, ARegionOfARunningJobIsRenderedAgain) {
  const std::string expected = RenderUndisturbed();
  const std::string job = BegunJob("begun");
  const int64_t before = Get(job)->units_done();
  const auto region = [](v1::RetryJobRequest& request) {
    request.mutable_region()->set_x0(8);
    request.mutable_region()->set_x1(9);
    request.mutable_region()->set_y1(1);
  };
  ASSERT_TRUE(Retry(job, region).ok());
  EXPECT_LT(Get(job)->units_done(), before);  // the middle is rendered first
  StopServer();
  StartServer();
  EXPECT_LT(Get(job)->units_done(), before);
  Render(job);
  EXPECT_EQ(*Download(job, 0), expected);
}

TEST_F(JobLifeTest, AFrameIsRenderedOrFilteredAgain) {
  const std::string expected = RenderUndisturbed();
  const std::string job = *Submit(Spec(), "undisturbed");
  ASSERT_TRUE(Retry(job, [](auto& request) { request.set_filter_only(true); }).ok());
  EXPECT_EQ(Render(job), 0);
  EXPECT_EQ(*Download(job, 0), expected);
  ASSERT_TRUE(Retry(job, [](auto& request) { request.add_frames(0); }).ok());
  EXPECT_EQ(Get(job)->units_done(), 0);
  EXPECT_EQ(Render(job), kUnits);
  EXPECT_EQ(*Download(job, 0), expected);
  EXPECT_EQ(Retry(job, [](auto& request) { request.add_frames(1); }).code(),
            absl::StatusCode::kInvalidArgument);
}

TEST_F(JobLifeTest, AnEndedJobGoesOnWhereItWas) {
  const std::string expected = RenderUndisturbed();
  const std::string job = BegunJob("begun");
  ASSERT_TRUE(Cancel(job).ok());
  const int64_t before = Get(job)->units_done();  // units that were delivered last are committed by now
  ASSERT_TRUE(Retry(job).ok());
  EXPECT_EQ(Get(job)->units_done(), before);
  EXPECT_EQ(Render(job), kUnits - before);
  EXPECT_EQ(*Download(job, 0), expected);
}

TEST_F(JobLifeTest, AJobIsDoneWithoutTheFramesThatItSkips) {
  v1::JobSpec spec = Spec();
  spec.set_frame_count(3);
  const std::string whole = *Submit(spec, "whole");
  EXPECT_EQ(Render(whole), 3 * kUnits);
  const std::string job = *Submit(spec, "with gaps");
  ASSERT_TRUE(Retry(job, [](auto& request) {
                request.set_skip(true);
                request.add_frames(1);
              }).ok());
  StopServer();
  StartServer();
  EXPECT_EQ(Get(job)->frames_skipped(), 1);
  {
    const auto worker = Worker();
    EXPECT_EQ(WaitForEnd(job).state(), v1::JOB_STATE_DONE_WITH_GAPS) << Get(job)->error();
    EXPECT_EQ(worker->delivered(), 2 * kUnits);
  }
  for (const int frame : {0, 2}) EXPECT_EQ(*Download(job, frame), *Download(whole, frame));
  EXPECT_EQ(Download(job, 1).status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(Download(job, 1).status().message()), HasSubstr("is skipped"));
  ASSERT_TRUE(Retry(job, [](auto& request) { request.set_skip(true); }).ok());
  EXPECT_EQ(Get(job)->state(), v1::JOB_STATE_DONE_WITH_GAPS) << "nothing has failed";
  ASSERT_TRUE(Retry(job).ok());
  EXPECT_EQ(Render(job), kUnits);
  EXPECT_EQ(*Download(job, 1), *Download(whole, 1));
}

TEST_F(JobLifeTest, UsageOfUnitsThatAReopenedJobKeepsCountsOnce) {
  const auto usage = [this] {
    v1::GetUsageResponse response;
    EXPECT_TRUE(Call(&v1::FarmService::Stub::GetUsage, v1::GetUsageRequest(), &response).ok());
    return response;
  };
  const std::string job = DoneJob("done");
  ASSERT_EQ(usage().jobs_size(), 1);
  EXPECT_EQ(usage().jobs(0).units(), kUnits);
  EXPECT_EQ(usage().jobs(0).frames(), 1);
  EXPECT_GT(usage().jobs(0).finish_seconds(), 0);
  ASSERT_TRUE(Retry(job, [](auto& request) { request.set_filter_only(true); }).ok());
  StopServer();
  StartServer();
  EXPECT_EQ(Render(job), 0);
  EXPECT_EQ(usage().jobs(0).units(), kUnits) << "they are kept";
  EXPECT_EQ(usage().jobs(0).frames(), 2) << "it was finished again";
  ASSERT_TRUE(Delete(job).ok());
  EXPECT_EQ(usage().jobs_size(), 1);
}

TEST_F(JobLifeTest, AJobWaitsForOthersAndThenRuns) {
  const std::string first = *Submit(Spec(), "first");
  const std::string second = *SubmitAfter({first}, "second");
  const std::string third = *SubmitAfter({second, first}, "third");
  EXPECT_EQ(Get(second)->state(), v1::JOB_STATE_SUBMITTED);
  StopServer();
  StartServer();
  EXPECT_EQ(Get(third)->state(), v1::JOB_STATE_SUBMITTED);
  const auto worker = Worker();
  EXPECT_EQ(WaitForEnd(third).state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(Get(second)->state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(*Download(first, 0), *Download(third, 0));
  EXPECT_EQ(Get(*SubmitAfter({first}, "fourth"))->units_total(), kUnits);
}

TEST_F(JobLifeTest, AJobFailsWithTheOneItWaitsFor) {
  const std::string first = *Submit(Spec(), "first");
  const std::string second = *SubmitAfter({first}, "second");
  const std::string third = *SubmitAfter({second}, "third");
  ASSERT_TRUE(Cancel(first).ok());
  EXPECT_EQ(WaitForEnd(third).state(), v1::JOB_STATE_FAILED);
  EXPECT_EQ(Get(second)->error(), absl::StrCat("job ", first, ", which it waits for, was cancelled"));
  EXPECT_EQ(Get(third)->error(), absl::StrCat("job ", second, ", which it waits for, has failed"));
  // Retried in their order they run.
  ASSERT_TRUE(Retry(first).ok());
  ASSERT_TRUE(Retry(second).ok());
  EXPECT_EQ(Get(second)->state(), v1::JOB_STATE_SUBMITTED);
  const auto worker = Worker();
  EXPECT_EQ(WaitForEnd(second).state(), v1::JOB_STATE_DONE);
}

TEST_F(JobLifeTest, JobsThatNobodyKnowsAndTooManyAreRefused) {
  EXPECT_THAT(std::string(SubmitAfter({"j-none"}, "a").status().message()), HasSubstr("no job \"j-none\""));
  const std::string job = *Submit(Spec(), "first");
  EXPECT_EQ(SubmitAfter(std::vector<std::string>(job::kMaxPrerequisites + 1, job), "b").status().code(),
            absl::StatusCode::kInvalidArgument);
}

TEST_F(JobLifeTest, ADeletedJobIsGone) {
  const std::string job = *Submit(Spec(), "first");
  const std::string other = *SubmitAfter({job}, "second");
  EXPECT_EQ(Delete(job).code(), absl::StatusCode::kFailedPrecondition);
  Render(job);
  Render(other);
  ASSERT_TRUE(Delete(job).ok());
  EXPECT_EQ(Get(job).status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(Delete(job).code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(Delete("../../film").code(), absl::StatusCode::kNotFound);
  for (const char* folder : {"film", "results", "deleted"})
    WaitFor([&] { return !fs::exists(PathIn(folder, job)); });
  EXPECT_EQ(Get(other)->state(), v1::JOB_STATE_DONE);
  EXPECT_NE(*Submit(Spec(), "first"), job);
}

TEST_F(JobLifeTest, DeletingAJobFailsThoseThatStillNameIt) {
  const std::string done = DoneJob("done");
  const std::string waiting = *Submit(Spec(), "waiting");
  const std::string job = *SubmitAfter({done, waiting}, "names both");
  EXPECT_EQ(Get(job)->state(), v1::JOB_STATE_SUBMITTED);
  ASSERT_TRUE(Delete(done).ok());
  EXPECT_EQ(WaitForEnd(job).error(), absl::StrCat("job ", done, ", which it waits for, was deleted"));
}

/// A coordinator that was killed after any step of a deletion.
TEST_F(JobLifeTest, AnInterruptedDeletionIsCompleted) {
  for (const bool row_is_gone : {false, true}) {
    const std::string job = DoneJob(absl::StrCat("job ", row_is_gone));
    if (row_is_gone) {
      WaitFor([&] { return fs::exists(PathIn("results", job) + "/manifest"); });
      fs::copy(PathIn("results", job), folder_.PathOf("kept"), fs::copy_options::recursive);
      ASSERT_TRUE(Delete(job).ok());
      WaitFor([&] { return !fs::exists(PathIn("deleted", job)); });
    }
    StopServer();
    if (row_is_gone) fs::copy(folder_.PathOf("kept"), PathIn("results", job), fs::copy_options::recursive);
    std::ofstream(PathIn("deleted", job)).flush();
    StartServer();
    for (const char* folder : {"deleted", "film", "results"})
      WaitFor([&] { return !fs::exists(PathIn(folder, job)); });
    EXPECT_EQ(Get(job).status().code(), absl::StatusCode::kNotFound);
  }
}

TEST_F(JobLifeTest, FilmOfTheJobsThatEndedFirstGoesFirst) {
  const std::string first = DoneJob("first");
  const std::string second = DoneJob("second");
  WaitFor([&] { return fs::exists(PathIn("results", second) + "/manifest"); });
  StopServer();
  uint64_t film = 0;
  for (const auto& entry : fs::recursive_directory_iterator(PathIn("film", second)))
    film += entry.is_regular_file() ? entry.file_size() : 0;
  ServerOptions options = Options();
  options.data.retention.film_bytes = film + film / 2;  // of one job
  StartServer(options);
  WaitFor([&] { return !fs::exists(PathIn("film", first)); });
  EXPECT_TRUE(fs::exists(PathIn("film", second)));
  EXPECT_TRUE(Download(first, 0).ok());
}

TEST_F(JobLifeTest, JobsAreDeletedAtTheirAge) {
  const std::string job = DoneJob("old");
  WaitFor([&] { return fs::exists(PathIn("results", job) + "/manifest"); });
  RestartWith([](ServerOptions& options) { options.data.retention.keep_results = absl::Hours(1); });
  const std::string young = DoneJob("young");
  EXPECT_TRUE(Get(job).ok());
  StopServer();
  fs::last_write_time(PathIn("results", job) + "/manifest",
                      fs::file_time_type::clock::now() - std::chrono::hours(2));
  ServerOptions options = Options();
  options.data.retention.keep_results = absl::Hours(1);
  StartServer(options);
  WaitFor([&] { return absl::IsNotFound(Get(job).status()); });
  WaitFor([&] { return !fs::exists(PathIn("results", job)); });
  EXPECT_TRUE(Get(young).ok());
}

TEST_F(JobLifeTest, TheQuotaRemovesEndedJobsAndThenRefusesNewOnes) {
  const std::string job = DoneJob("done");
  const std::string running = BegunJob("running");
  const v1::JobSpec spec = Spec();
  RestartWith([](ServerOptions& options) { options.data.retention.quota_bytes = 1000; });
  WaitFor([&] { return absl::IsNotFound(Get(job).status()); });
  const absl::Status refused = Submit(spec, "new").status();
  EXPECT_EQ(refused.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_THAT(std::string(refused.message()), HasSubstr("quota of 1000 bytes"));
  EXPECT_GE(Get(running)->units_done(), 8);
  v1::AssetRef asset;
  asset.set_sha256(rpc::Sha256Hex("oak"));
  asset.set_size(3);
  EXPECT_EQ(Upload(asset, "oak", 3).error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
}

TEST_F(JobLifeTest, AnUploadThatExceedsTheQuotaIsRefused) {
  RestartWith([](ServerOptions& options) { options.data.retention.quota_bytes = 1'000'000; });
  v1::AssetRef asset;
  asset.set_sha256(std::string(64, 'a'));
  asset.set_size(Limits().assets.asset_bytes);
  const auto stub = v1::FarmService::NewStub(Channel());
  for (int i = 0; i < 20; ++i) {
    grpc::ClientContext context;
    v1::UploadAssetResponse response;
    const auto writer = stub->UploadAsset(&context, &response);
    v1::UploadAssetRequest request;
    *request.mutable_announce() = asset;
    writer->Write(request);
    request.mutable_chunk()->set_data("x");
    request.mutable_chunk()->set_checksum(rpc::Checksum("x"));
    request.mutable_chunk()->set_total_size(asset.size());
    writer->Write(request);
    EXPECT_EQ(writer->Finish().error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  }
  EXPECT_TRUE(fs::is_empty(folder_.PathOf("data/incoming")));
}

TEST_F(JobLifeTest, JobsAreToldAfterARestartAsBefore) {
  const std::string done = DoneJob("done");
  const std::string first = *Submit(Spec(), "first");
  v1::SubmitJobRequest request;
  *request.mutable_spec() = Spec();
  request.set_request_id("all");
  v1::Scheduling& scheduling = *request.mutable_scheduling();
  scheduling.set_priority(7);
  scheduling.add_tags("gpu");
  scheduling.set_max_leases(3);
  scheduling.set_numeric_class("sse2");
  scheduling.set_paused(true);
  scheduling.set_audit_share(0.5);
  scheduling.set_name("shot 7");
  v1::SubmitJobResponse paused;
  ASSERT_TRUE(Call(&v1::FarmService::Stub::SubmitJob, request, &paused).ok());
  const std::vector<std::string> jobs = {done, first, paused.job_id(), *SubmitAfter({first}, "waits")};
  const auto told = [&] {
    v1::ListJobsResponse list;
    EXPECT_TRUE(Call(&v1::FarmService::Stub::ListJobs, v1::ListJobsRequest(), &list).ok());
    std::string text;
    for (const std::string& job : jobs) *list.add_jobs() = *Get(job);
    for (v1::JobStatus& status : *list.mutable_jobs()) {
      status.clear_coordinator();  // another port
      absl::StrAppend(&text, status.DebugString(), "\n");
    }
    return text;
  };
  const std::string before = told();
  RestartWith([](ServerOptions&) {});
  EXPECT_EQ(told(), before);
}

}  // namespace
}  // namespace lumifold::server
