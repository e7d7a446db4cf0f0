#include "server/server.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "filter/image/exr_io.h"
#include "proto/rpc/image_codec.h"
#include "proto/rpc/limits.h"
#include "server/job/limits.h"
#include "server/ledger/sqlite_job_store.h"
#include "tests/support/film_of_units.h"
#include "tests/unit/server/farm_fixture.h"
#include "tests/unit/server/holding_worker.h"

namespace lumifold::server {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

using ServerTest = FarmFixture;

TEST_F(ServerTest, ATinyJobBecomesAPicture) {
  const v1::JobSpec spec = Spec();
  const absl::StatusOr<std::string> job = Submit(spec);
  ASSERT_TRUE(job.ok()) << job.status();
  EXPECT_EQ(Get(*job)->state(), v1::JOB_STATE_PLANNED);
  EXPECT_EQ(Download(*job, 0).status().code(), absl::StatusCode::kFailedPrecondition);
  const auto worker = Worker();
  const v1::JobStatus status = WaitForEnd(*job);
  EXPECT_EQ(status.state(), v1::JOB_STATE_DONE) << status.error();
  EXPECT_EQ(status.units_done(), kUnits);
  EXPECT_EQ(status.units_total(), kUnits);
  EXPECT_EQ(status.samples_done(), 20 * 12 * 10);
  EXPECT_EQ(status.frames_done(), 1);
  EXPECT_EQ(status.display_name(), "made-up.glb");
  EXPECT_THAT(status.warnings(), ElementsAre("made up"));
  EXPECT_EQ(worker->delivered(), kUnits);

  const absl::StatusOr<std::string> bytes = Download(*job, 0);
  ASSERT_TRUE(bytes.ok()) << bytes.status();
  const std::string path = folder_.PathOf("downloaded.exr");
  std::ofstream(path, std::ios::binary) << *bytes;
  const absl::StatusOr<LayeredImage> result = ReadExr(path);
  ASSERT_TRUE(result.ok()) << result.status();
  const absl::StatusOr<EdgedImage> film = WholeFilm(spec, 0, RandomUnitsOf(spec, 1));
  for (const char* channel : {"noisy.R", "direct.G", "albedo.B", "Z", "A"}) {
    EXPECT_EQ(result->Get(channel).At(19, 11), film->pixels.Get(channel).At(19, 11)) << channel;
  }
}

TEST_F(ServerTest, ABrokenDownloadIsResumed) {
  const std::string whole = RenderUndisturbed();
  const std::string job = *Submit(Spec(), "undisturbed");  // the same request: the same job
  const uint64_t middle = whole.size() / 2;
  EXPECT_EQ(whole.substr(0, middle) + *Download(job, 0, middle), whole);
  EXPECT_EQ(*Download(job, 0, whole.size()), "");
  EXPECT_EQ(Download(job, 0, whole.size() + 1).status().code(), absl::StatusCode::kOutOfRange);
  EXPECT_EQ(Download(job, 1).status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(Download("j-none", 0).status().code(), absl::StatusCode::kNotFound);
}

TEST_F(ServerTest, UnitsOfAWorkerThatVanishesGoToOthersAndThePictureIsTheSame) {
  const std::string expected = RenderUndisturbed();
  const std::string job = *Submit(Spec(), "disturbed");
  const auto victim = Worker({.slots = 4, .vanish_after = 5});
  victim->Wait();
  EXPECT_EQ(victim->delivered(), 5);
  const auto ann = Worker({.slots = 1});
  const auto ben = Worker({.slots = 2});
  EXPECT_EQ(WaitForEnd(job).state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(*Download(job, 0), expected);
}

TEST_F(ServerTest, ARestartedCoordinatorContinuesAndNothingAcknowledgedIsLost) {
  const std::string expected = RenderUndisturbed();
  const std::string job = *Submit(Spec(), "restarted");
  const auto victim = Worker({.slots = 1, .vanish_after = 9});
  victim->Wait();
  const int64_t committed =
      WaitUntil(job, [](const v1::JobStatus& s) { return s.units_done() >= 8; }).units_done();
  StopServer();
  StartServer();
  EXPECT_GE(Get(job)->units_done(), committed);
  const int64_t restored = Get(job)->units_done();
  const auto worker = Worker();
  EXPECT_EQ(WaitForEnd(job).state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(worker->delivered(), kUnits - restored);
  EXPECT_EQ(*Download(job, 0), expected);
}

/// Damages the log of a frame that is being rendered.
enum class Damage { kFlippedByte, kCut, kDeleted };

void Inflict(Damage damage, const std::string& log) {
  switch (damage) {
    case Damage::kFlippedByte: {
      std::fstream file(log, std::ios::in | std::ios::out | std::ios::binary);
      file.seekg(1000);
      const char byte = static_cast<char>(file.get());
      file.seekp(1000);
      file.put(static_cast<char>(byte ^ 1));
      break;
    }
    case Damage::kCut:
      std::filesystem::resize_file(log, std::filesystem::file_size(log) / 2);
      break;
    case Damage::kDeleted:
      std::filesystem::remove(log);
  }
}

TEST_F(ServerTest, UnitsOfADamagedLogAreRenderedAgainAndThePictureIsTheSame) {
  const std::string expected = RenderUndisturbed();
  int number = 0;
  for (const bool restarts : {false, true}) {
    for (const Damage damage : {Damage::kFlippedByte, Damage::kCut, Damage::kDeleted}) {
      SCOPED_TRACE(number);
      const std::string job = *Submit(Spec(), absl::StrCat("log-", number++));
      const auto victim = Worker({.slots = 1, .vanish_after = 9});
      victim->Wait();
      WaitUntil(job, [](const v1::JobStatus& s) { return s.units_done() >= 8; });
      if (restarts) StopServer();
      Inflict(damage, folder_.PathOf(absl::StrCat("data/film/", job, "/frame-0000.units")));
      if (restarts) StartServer();
      const auto worker = Worker();
      const v1::JobStatus status = WaitForEnd(job);
      EXPECT_EQ(status.state(), v1::JOB_STATE_DONE) << status.error();
      EXPECT_EQ(status.units_done(), kUnits);
      EXPECT_EQ(status.samples_done(), 20 * 12 * 10);
      EXPECT_GT(worker->delivered(), kUnits - 9);
      EXPECT_EQ(*Download(job, 0), expected);
    }
  }
}

TEST_F(ServerTest, ADamagedUnitIsRenderedAgain) {
  const std::string expected = RenderUndisturbed();
  const std::string job = *Submit(Spec(), "damaged");
  std::atomic<int> damaged{0};
  const auto worker = Worker({.spoil = [&](v1::WorkerMessage& message) {
    if (!message.has_chunk() || message.chunk().unit().tile() != 2 || damaged > 1) return;
    // First the edge set of the tile's geometry unit, which precedes the pixels, then the pixels.
    if (message.chunk().has_edges() != (damaged == 0)) return;
    ++damaged;
    v1::UnitChunk* chunk = message.mutable_chunk();
    v1::PixelChunk* piece = chunk->has_edges() ? chunk->mutable_edges() : chunk->mutable_pixels();
    (*piece->mutable_data())[3] ^= 1;
  }});
  EXPECT_EQ(WaitForEnd(job).state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(damaged, 2);
  EXPECT_GE(worker->delivered(), kUnits + 1);
  EXPECT_EQ(*Download(job, 0), expected);
}

/// Replaces the first value of a channel in a piece that has all pixels of a small unit.
void SetFirstValue(const std::string& channel, float value, v1::PixelChunk* piece) {
  absl::StatusOr<LayeredImage> image = rpc::ImageFromBytes(piece->layout(), piece->data(), {});
  ASSERT_TRUE(image.ok());
  image->Get(channel).At(0, 0) = value;
  rpc::PixelChunker(*image).Next(piece);
}

TEST_F(ServerTest, AUnitWithInvalidValuesIsRefusedAndRenderedAgain) {
  const std::string expected = RenderUndisturbed();
  const std::string job = *Submit(Spec(), "invalid");
  const std::vector<std::pair<const char*, float>> flaws = {
      {"noisy_a.R", NAN}, {"samples_a.Y", -1.0f}, {"samples_b.Y", 1e6f}};
  std::atomic<size_t> next{0};
  const auto worker = Worker({.spoil = [&](v1::WorkerMessage& message) {
    const v1::UnitId& unit = message.chunk().unit();
    const bool is_pass = message.chunk().has_pixels() && unit.kind() == v1::UNIT_KIND_PASS;
    if (!is_pass || next == flaws.size() || unit.tile() != static_cast<int>(next)) return;
    const auto& [channel, value] = flaws[next++];
    SetFirstValue(channel, value, message.mutable_chunk()->mutable_pixels());
  }});
  EXPECT_EQ(WaitForEnd(job).state(), v1::JOB_STATE_DONE);
  EXPECT_THAT(worker->refusals(),
              ElementsAre("unit: noisy_a.R is nan at 0,0, not finite",
                          "unit: samples_a.Y is -1 at 8,0, not a whole number from 0 to 2",
                          "unit: samples_b.Y is 1e+06 at 16,0, not a whole number from 0 to 2"));
  EXPECT_EQ(*Download(job, 0), expected);
}

TEST_F(ServerTest, AJobWhoseUnitIsAlwaysInvalidFailsWithTheReason) {
  RestartForOneWorker();
  const std::string job = *Submit(Spec());
  const auto worker = Worker({.spoil = [](v1::WorkerMessage& message) {
    if (message.chunk().has_pixels() && message.chunk().unit().kind() == v1::UNIT_KIND_PASS)
      SetFirstValue("samples_a.Y", -1.0f, message.mutable_chunk()->mutable_pixels());
  }});
  const v1::JobStatus status = WaitForEnd(job);
  EXPECT_EQ(status.state(), v1::JOB_STATE_FAILED);
  EXPECT_THAT(status.error(), HasSubstr("which is not valid: unit: samples_a.Y is -1 at"));
}

TEST_F(ServerTest, TextOfWorkersIsBoundedAndTheJobStaysReadable) {
  const std::string job = *Submit(Spec());
  std::atomic<int> units{0};
  const auto worker = Worker({.spoil = [&](v1::WorkerMessage& message) {
    if (!message.chunk().has_stats()) return;
    v1::UnitStats* stats = message.mutable_chunk()->mutable_stats();
    const int unit = units++;
    for (int i = 0; i < 30; ++i)
      stats->add_warnings(absl::StrCat(unit, " ", i, "\n", std::string(100'000, 'x')));
  }});
  const v1::JobStatus status = WaitForEnd(job);
  EXPECT_EQ(status.state(), v1::JOB_STATE_DONE) << status.error();
  EXPECT_LT(status.ByteSizeLong(), 60'000u);
  ASSERT_EQ(status.warnings_size(), job::kMaxJobWarnings + 1);
  EXPECT_THAT(status.warnings(1), HasSubstr("bytes left out)"));
  // Each unit has 31 different lines, of which "made up" is the first.
  const int left_out = kUnits * 30 + 1 - job::kMaxJobWarnings;
  EXPECT_EQ(*status.warnings().rbegin(),
            absl::StrCat(left_out, " further warnings of units are left out: a job keeps 100"));
  EXPECT_TRUE(Download(job, 0).ok());
  StopServer();
  StartServer();
  EXPECT_EQ(*Get(job)->warnings().rbegin(), *status.warnings().rbegin());
}

TEST_F(ServerTest, AListOfJobsWithLongErrorsFitsAMessage) {
  RestartForOneWorker();
  const std::string job = *Submit(Spec());
  const auto worker = Worker({.spoil = [](v1::WorkerMessage& message) {
    if (!message.has_chunk()) return;
    v1::UnitFailure failure;
    *failure.mutable_unit() = message.chunk().unit();
    failure.set_attempt(message.chunk().attempt());
    failure.set_error("broken\n" + std::string(3'000'000, 'x'));
    failure.set_permanent(true);
    *message.mutable_failure() = failure;
  }});
  const v1::JobStatus status = WaitForEnd(job);
  EXPECT_EQ(status.error().substr(0, 8), "broken x");
  EXPECT_THAT(status.error(), HasSubstr("bytes left out)"));
  EXPECT_LE(status.error().size(), rpc::kMaxErrorBytes);
  const auto stub = v1::FarmService::NewStub(Channel());
  grpc::ClientContext context;
  v1::ListJobsResponse jobs;
  ASSERT_TRUE(stub->ListJobs(&context, {}, &jobs).ok());
  ASSERT_EQ(jobs.jobs_size(), 1);
  EXPECT_LE(jobs.jobs(0).ByteSizeLong(), 512u);
}

TEST_F(ServerTest, AWorkerWithALongNameIsRefused) {
  const auto worker = Worker({.numeric_class = std::string(rpc::kMaxWorkerNameBytes + 1, 'x')});
  const grpc::Status status = worker->Wait();
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_THAT(status.error_message(), HasSubstr("numeric_class 257, allowed are 256"));
}

TEST_F(ServerTest, UnitsWithoutALeaseAreDropped) {
  const std::string expected = RenderUndisturbed();
  const std::string job = *Submit(Spec(), "forged");
  std::atomic<int> forged{0};
  const auto forger = Worker({.slots = 2, .vanish_after = 1, .spoil = [&](v1::WorkerMessage& message) {
                                if (!message.has_chunk()) return;
                                message.mutable_chunk()->set_attempt(message.chunk().attempt() +
                                                                     (forged++ % 2 == 0 ? 1000 : -1));
                              }});
  forger->Wait();
  EXPECT_EQ(Get(job)->units_done(), 0);
  const auto worker = Worker();
  EXPECT_EQ(WaitForEnd(job).state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(*Download(job, 0), expected);
}

TEST_F(ServerTest, EveryFrameOfAJobIsAFile) {
  v1::JobSpec spec = Spec();
  spec.set_first_frame(7);
  spec.set_frame_count(3);
  const std::string job = *Submit(spec);
  const auto ann = Worker();
  const auto ben = Worker();
  EXPECT_EQ(WaitForEnd(job).state(), v1::JOB_STATE_DONE);
  const std::string first = *Download(job, 7);
  EXPECT_NE(first, *Download(job, 8));
  EXPECT_NE(first, *Download(job, 9));
}

TEST_F(ServerTest, APermanentFailureFailsTheJobWithTheWorkersError) {
  RestartForOneWorker();
  const std::string job = *Submit(Spec());
  const auto worker = Worker({.spoil = [](v1::WorkerMessage& message) {
    if (!message.has_chunk()) return;
    v1::UnitFailure failure;
    *failure.mutable_unit() = message.chunk().unit();
    failure.set_attempt(message.chunk().attempt());
    failure.set_error("room.glb: accessor 3 reads past its buffer");
    failure.set_permanent(true);
    *message.mutable_failure() = failure;
  }});
  const v1::JobStatus status = WaitForEnd(job);
  EXPECT_EQ(status.state(), v1::JOB_STATE_FAILED);
  EXPECT_EQ(status.error(), "room.glb: accessor 3 reads past its buffer");
}

TEST_F(ServerTest, AJobWhoseUnitCrashesItsWorkersFailsBeforeAllOfThemAreGone) {
  const std::string job = *Submit(Spec());
  for (int i = 0; i < 4; ++i) {
    const auto rename = [i](v1::WorkerMessage& message) {
      if (message.has_hello()) message.mutable_hello()->set_name("node" + std::to_string(i));
    };
    Worker({.slots = 1, .vanish_after = 0, .answers_grants = true, .spoil = rename})->Wait();
    WaitUntil(job, [](const v1::JobStatus& status) {  // the coordinator has noticed
      return status.workers() == 0 || status.state() == v1::JOB_STATE_FAILED;
    });
  }
  const v1::JobStatus status = WaitForEnd(job);
  EXPECT_EQ(status.state(), v1::JOB_STATE_FAILED);
  EXPECT_THAT(status.error(), HasSubstr("workers were lost with it 4 times"));
  EXPECT_THAT(status.error(), HasSubstr("node0, node1, node2, node3"));
}

TEST_F(ServerTest, OneWorkerThatCallsEveryUnitBrokenFailsNoJob) {
  const auto good = Worker({.slots = 1});
  EXPECT_EQ(WaitForEnd(*Submit(Spec())).state(), v1::JOB_STATE_DONE);  // so it is connected
  const auto bad = Worker({.slots = 1, .spoil = [](v1::WorkerMessage& message) {
                             if (message.has_hello()) message.mutable_hello()->set_name("bad");
                             if (!message.has_chunk()) return;
                             v1::UnitFailure failure;
                             *failure.mutable_unit() = message.chunk().unit();
                             failure.set_attempt(message.chunk().attempt());
                             failure.set_error("no such file");
                             failure.set_permanent(true);
                             *message.mutable_failure() = failure;
                           }});
  for (int i = 0; i < 10; ++i) {
    const v1::JobStatus status = WaitForEnd(*Submit(Spec(), "again-" + std::to_string(i)));
    EXPECT_EQ(status.state(), v1::JOB_STATE_DONE) << status.error();
  }
}

TEST_F(ServerTest, AStopOfTheCoordinatorBlamesNoUnit) {
  const std::string job = *Submit(Spec());
  const auto hold = [](v1::WorkerMessage& message) {
    if (message.has_chunk()) message.mutable_chunk()->set_attempt(0);  // never accepted
  };
  const auto none_left = [](const v1::JobStatus& status) { return status.workers() == 0; };
  for (int i = 0; i < 6; ++i) {
    Worker({.slots = 1, .vanish_after = 0})->Wait();
    WaitUntil(job, none_left);
  }
  const auto last = Worker({.slots = 1, .spoil = hold});  // renders the unit alone
  WaitUntil(job, [](const v1::JobStatus& status) { return status.workers() == 1; });
  StopServer();
  StartServer();
  EXPECT_EQ(Get(job)->state(), v1::JOB_STATE_PLANNED);
}

TEST_F(ServerTest, ACancelledJobFreesItsWorkersAndStaysCancelled) {
  const std::string job = *Submit(Spec());
  const auto worker = Worker({.slots = 1, .spoil = [](v1::WorkerMessage& message) {
                                if (message.has_chunk())
                                  message.mutable_chunk()->set_attempt(0);  // without a valid lease: dropped
                              }});
  WaitUntil(job, [](const v1::JobStatus& status) { return status.state() == v1::JOB_STATE_RUNNING; });
  const auto stub = v1::FarmService::NewStub(Channel());
  for (int repeat = 0; repeat < 2; ++repeat) {
    grpc::ClientContext context;
    v1::CancelJobRequest request;
    request.set_job_id(job);
    v1::JobStatus status;
    ASSERT_TRUE(stub->CancelJob(&context, request, &status).ok());
    EXPECT_EQ(status.state(), v1::JOB_STATE_CANCELLED);
  }
  EXPECT_TRUE(worker->WaitForEndOf(job));
  StopServer();
  StartServer();
  EXPECT_EQ(Get(job)->state(), v1::JOB_STATE_CANCELLED);
}

TEST_F(ServerTest, JobsAreRefusedWithTheFieldsName) {
  v1::JobSpec spec = Spec();
  spec.set_width(0);
  EXPECT_THAT(std::string(Submit(spec).status().message()), HasSubstr("width is 0"));
  spec = Spec();
  spec.mutable_filter()->set_method("magic");
  EXPECT_THAT(std::string(Submit(spec).status().message()),
              HasSubstr("filter.method: no method is named \"magic\"; there are: default"));
  spec = Spec();
  v1::AssetRef* missing = spec.mutable_scene()->add_dependencies();
  missing->set_uri("wood.png");
  missing->set_sha256(std::string(64, '0'));
  const absl::Status status = Submit(spec).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(status.message()), HasSubstr("'wood.png'"));
  missing->set_sha256("../../etc/passwd");
  EXPECT_EQ(Submit(spec).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(Submit(Spec(), "").status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(Submit(Spec(), std::string(job::kMaxRequestIdBytes + 1, 'x')).status().message(),
            "request_id has 129 bytes, not 1 to 128");
  EXPECT_EQ(Get("j-none").status().code(), absl::StatusCode::kNotFound);
}

grpc::Status FetchSpec(const std::shared_ptr<grpc::Channel>& channel, const std::string& worker_id,
                       const std::string& job_id, v1::JobSpec* spec) {
  grpc::ClientContext context;
  v1::FetchSpecRequest request;
  request.set_worker_id(worker_id);
  request.set_job_id(job_id);
  return v1::WorkerService::NewStub(channel)->FetchSpec(&context, request, spec);
}

TEST_F(ServerTest, TheLargestSpecReachesTheWorkersAndOneThatIsTooLargeIsRefused) {
  v1::JobSpec spec = Spec();
  const v1::AssetRef file = spec.scene().file();
  while (spec.ByteSizeLong() + 2 * job::kMaxUriBytes < job::kMaxSpecBytes) {
    v1::AssetRef* dependency = spec.mutable_scene()->add_dependencies();
    *dependency = file;
    dependency->set_uri(
        absl::StrCat(spec.scene().dependencies_size(), std::string(job::kMaxUriBytes - 8, 'x')));
  }
  const absl::StatusOr<std::string> job = Submit(spec);
  ASSERT_TRUE(job.ok()) << job.status();
  v1::JobSpec fetched;
  {
    HoldingWorker holder(Channel());
    ASSERT_EQ(holder.AwaitGrant(), *job);
    ASSERT_TRUE(FetchSpec(Channel(), holder.id(), *job, &fetched).ok());
  }
  EXPECT_GT(fetched.ByteSizeLong(), job::kMaxSpecBytes - 3 * job::kMaxUriBytes);
  EXPECT_EQ(fetched.scene().dependencies_size(), spec.scene().dependencies_size());
  const auto worker = Worker({.slots = 1000});
  EXPECT_EQ(WaitForEnd(*job).state(), v1::JOB_STATE_DONE);
  for (int i = 0; i < 3; ++i) *spec.mutable_scene()->add_dependencies() = spec.scene().dependencies(i);
  EXPECT_THAT(std::string(Submit(spec, "too large").status().message()), HasSubstr("the spec has"));
}

TEST_F(ServerTest, ARecordedJobThatExceedsTheLimitsFailsAtTheStart) {
  const v1::JobSpec spec = Spec();
  StopServer();
  v1::JobSpec large = spec;
  large.set_tile_size(8);
  large.set_frames_per_second(24);
  large.set_camera(std::string(4'000'000, 'x'));
  {
    const auto store = *ledger::OpenSqliteJobStore(folder_.PathOf("data/ledger.db"));
    const ledger::NewJob job{
        .id = job::JobId("j-old"), .request_id = "old", .spec = large, .submitted = absl::Now()};
    ASSERT_TRUE(store->CreateJob(job).ok());
    const ledger::NewJob empty{
        .id = job::JobId("j-empty"), .request_id = "empty", .spec = {}, .submitted = absl::Now()};
    ASSERT_TRUE(store->CreateJob(empty).ok());
  }
  StartServer();
  EXPECT_EQ(WaitForEnd("j-old").state(), v1::JOB_STATE_FAILED);
  EXPECT_THAT(Get("j-old")->error(), HasSubstr("the job's spec is not valid: camera has 4000000 bytes"));
  EXPECT_EQ(WaitForEnd("j-empty").state(), v1::JOB_STATE_FAILED);
  const std::string job = *Submit(spec);
  const auto worker = Worker();
  EXPECT_EQ(WaitForEnd(job).state(), v1::JOB_STATE_DONE);
}

TEST_F(ServerTest, AWorkerOfAnotherWireVersionIsRefused) {
  const grpc::Status status = Worker({.wire_version = 99})->Wait();
  EXPECT_EQ(status.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_THAT(status.error_message(), HasSubstr("wire version 99"));
  EXPECT_EQ(Worker({.slots = 0})->Wait().error_code(), grpc::StatusCode::INVALID_ARGUMENT);
}

TEST_F(ServerTest, UploadsAreCheckedAndListedAsMissingUntilThen) {
  v1::JobSpec spec = Spec();
  v1::AssetRef asset = spec.scene().file();
  asset.set_sha256(std::string(64, '1'));
  EXPECT_EQ(Upload(asset, std::string(asset.size(), 'x'), 5).error_code(), grpc::StatusCode::DATA_LOSS);
  v1::FindMissingAssetsRequest request;
  *request.add_assets() = asset;
  *request.add_assets() = asset;
  *request.add_assets() = spec.scene().file();
  v1::FindMissingAssetsResponse response;
  grpc::ClientContext context;
  ASSERT_TRUE(v1::FarmService::NewStub(Channel())->FindMissingAssets(&context, request, &response).ok());
  EXPECT_THAT(response.missing_sha256(), ElementsAre(asset.sha256()));
  EXPECT_TRUE(std::filesystem::is_empty(folder_.PathOf("data/incoming")));
}

TEST_F(ServerTest, ADamagedAssetIsMissingAfterARestartUntilItIsUploadedAgain) {
  const v1::JobSpec spec = Spec();
  const v1::AssetRef file = spec.scene().file();
  StopServer();
  {
    std::fstream asset(folder_.PathOf("data/assets/" + file.sha256()), std::ios::in | std::ios::out);
    asset.seekp(3).put('!');
  }
  StartServer();
  const auto stub = v1::FarmService::NewStub(Channel());
  grpc::ClientContext context;
  v1::FindMissingAssetsRequest request;
  *request.add_assets() = file;
  v1::FindMissingAssetsResponse response;
  ASSERT_TRUE(stub->FindMissingAssets(&context, request, &response).ok());
  EXPECT_THAT(response.missing_sha256(), ElementsAre(file.sha256()));
  EXPECT_EQ(Submit(spec, "early").status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_TRUE(Submit(Spec(), "healed").ok());  // Spec() uploads it
}

TEST_F(ServerTest, AFolderHasOneCoordinator) {
  const absl::Status status = Server::Start(Options()).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(status.message()), HasSubstr("another coordinator"));
}

TEST_F(ServerTest, AnIncompleteResultIsRemovedAtTheStart) {
  StopServer();
  const std::string partial = folder_.PathOf("data/results/j-1/frame-0000.exr.12-0.partial");
  const std::string whole = folder_.PathOf("data/results/j-1/frame-0001.exr");
  std::filesystem::create_directories(folder_.PathOf("data/results/j-1"));
  for (const std::string& path : {partial, whole}) std::ofstream(path) << "pixels";
  StartServer();
  EXPECT_FALSE(std::filesystem::exists(partial));
  EXPECT_TRUE(std::filesystem::exists(whole));
}

TEST_F(ServerTest, WithinOneProcessThePictureIsTheSame) {
  const std::string expected = RenderUndisturbed();
  StopServer();
  ServerOptions options = Options();
  options.data.folder = folder_.PathOf("local");
  options.listen = "";
  StartServer(options);
  EXPECT_EQ(server_->port(), 0);
  EXPECT_EQ(RenderUndisturbed(), expected);
}

TEST_F(ServerTest, LeasesOfASilentWorkerExpireAndGoToOthers) {
  const std::string expected = RenderUndisturbed();
  StopServer();
  ServerOptions options = Options();
  // Leases expire when the test moves the clock, not because the machine is busy.
  const auto skipped_seconds = std::make_shared<std::atomic<int64_t>>(0);
  options.lease = absl::Minutes(5);
  options.now = [skipped_seconds] { return absl::Now() + absl::Seconds(skipped_seconds->load()); };
  StartServer(options);
  const std::string job = *Submit(Spec(), "silent");
  const auto silent = Worker({.slots = 4, .spoil = [](v1::WorkerMessage& message) {
                                if (message.has_chunk())
                                  *message.mutable_failure() =
                                      v1::UnitFailure();  // of a unit that it does not hold: ignored
                              }});
  WaitUntil(job, [](const v1::JobStatus& status) { return status.workers() == 1; });
  *skipped_seconds = 301;
  const auto worker = Worker();
  EXPECT_EQ(WaitForEnd(job).state(), v1::JOB_STATE_DONE);
  EXPECT_EQ(worker->delivered(), kUnits);
  EXPECT_EQ(*Download(job, 0), expected);
}

TEST_F(ServerTest, ALeaseMustOutlastTwoHeartbeats) {
  ServerOptions options = Options();
  options.data.folder = folder_.PathOf("other");
  options.lease = absl::Seconds(5);
  EXPECT_EQ(Server::Start(options).status().code(), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace lumifold::server
