// Each limit of server/services/call_limits.h and of jobs, and a step past it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <functional>
#include <list>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "proto/rpc/checksum.h"
#include "proto/rpc/limits.h"
#include "proto/rpc/sha256.h"
#include "proto/rpc/version.h"
#include "tests/unit/server/gate_fixture.h"

namespace lumifold::server {
namespace {

using ::testing::AnyOf;
using ::testing::HasSubstr;
using Stub = v1::FarmService::Stub;

constexpr char kAnn[] = "person/ann/submit";
constexpr char kBob[] = "person/bob/submit";
constexpr uint64_t kAssetBytes = 1'000'000;

class LimitsTest : public GateFixture {
 protected:
  grpc::Status Status(const std::string& caller) {
    v1::ServerStatus status;
    return Call(caller, &Stub::GetServerStatus, v1::GetServerStatusRequest(), &status);
  }

  /// An upload that announces an asset and sends nothing of it.
  struct HalfUpload {
    std::unique_ptr<grpc::ClientContext> context;
    v1::UploadAssetResponse response;
    std::unique_ptr<grpc::ClientWriter<v1::UploadAssetRequest>> writer;
  };
  HalfUpload* Announce(const std::string& caller, int number, uint64_t size) {
    HalfUpload& upload = uploads_.emplace_back();
    upload.context = As(caller);
    upload.writer = farm().UploadAsset(upload.context.get(), &upload.response);
    v1::UploadAssetRequest request;
    request.mutable_announce()->set_uri(absl::StrCat("file-", number));
    request.mutable_announce()->set_sha256(rpc::Sha256Hex(absl::StrCat("content ", number)));
    request.mutable_announce()->set_size(size);
    upload.writer->Write(request);
    return &upload;
  }
  /// How an upload ends that the coordinator refuses.
  static grpc::Status EndOf(HalfUpload* upload) { return upload->writer->Finish(); }
  /// Sends the next `bytes` of the asset 1.
  static void Send(HalfUpload* upload, uint64_t* sent, uint64_t bytes) {
    v1::UploadAssetRequest request;
    v1::ByteChunk* chunk = request.mutable_chunk();
    chunk->set_offset(std::exchange(*sent, *sent + bytes));
    chunk->set_data(std::string(bytes, 'x'));
    chunk->set_checksum(rpc::Checksum(chunk->data()));
    chunk->set_total_size(kAssetBytes);
    upload->writer->Write(request);
  }

  /// A job of kAnn's with a result of `chunks` chunks.
  void FinishJob(int chunks) {
    StoreScene();
    ASSERT_TRUE(SubmitAs(kAnn, "downloaded", "", &job_).ok());
    PumpedWorker worker(coordinator_.get(), 1);
    ASSERT_EQ(Finish(job::JobId(job_), &worker).state(), v1::JOB_STATE_DONE);
    std::filesystem::resize_file(data_.ResultPath(job::JobId(job_), 0),
                                 static_cast<uint64_t>(chunks) * rpc::kMaxChunkBytes);
  }
  /// Starts to download that.
  std::unique_ptr<grpc::ClientReader<v1::ByteChunk>> Download() {
    v1::DownloadResultRequest request;
    request.set_job_id(job_);
    context_ = As(kAnn);
    return farm().DownloadResult(context_.get(), request);
  }
  /// The same, until the coordinator waits for the reader: looks at the clock are for the rate of calls and
  /// for that.
  std::unique_ptr<grpc::ClientReader<v1::ByteChunk>> AwaitDownload() {
    const int before = clock_reads();
    auto reader = Download();
    Await([&] { return clock_reads() == before + 2; });
    return reader;
  }
  /// Announces the asset 1, until the coordinator waits for its first bytes: as above, and then the
  /// announcement has moved.
  HalfUpload* AwaitUpload() {
    const int before = clock_reads();
    HalfUpload* upload = Announce(kAnn, 1, kAssetBytes);
    Await([&] { return clock_reads() == before + 4; });
    return upload;
  }

  /// Lets the only stream stall, where the limit is 10 s.
  void AwaitStall() {
    Await([&] {
      Advance(absl::Seconds(10));
      return EndStalledStreams() == 1;
    });
  }

  /// Of the only stream: moves a message with `move`, then the clock by `pause`, until the stream is ended;
  /// at most `most` times. Returns how often.
  int Drip(int most, absl::Duration pause, const std::function<void()>& move) {
    int moved = 0;
    for (size_t ended = 0; moved < most && ended == 0; ++moved) {
      const int before = clock_reads();
      move();
      // One look at the clock when the message has moved, one when the coordinator waits for the next.
      Await([&] { return clock_reads() == before + 2; });
      Advance(pause);
      ended = EndStalledStreams();
    }
    return moved;
  }

  ~LimitsTest() override {
    for (HalfUpload& upload : uploads_) upload.context->TryCancel();
  }

  std::list<HalfUpload> uploads_;
  std::string job_;
  std::unique_ptr<grpc::ClientContext> context_;
};

TEST_F(LimitsTest, RequestsASecond) {
  StartGate({.requests_per_second = 10, .request_burst = 3});
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(Status(kAnn).ok());
  const grpc::Status refused = Status(kAnn);
  EXPECT_EQ(refused.error_code(), grpc::StatusCode::UNAVAILABLE);
  EXPECT_EQ(refused.error_message(), "too many requests: a caller may make 10 a second");
  EXPECT_TRUE(Status(kBob).ok()) << "each caller has its own limit";
  EXPECT_FALSE(Status("person/ann/read").ok()) << "another token of the same person";
  Advance(absl::Milliseconds(100));
  EXPECT_TRUE(Status(kAnn).ok());
  EXPECT_FALSE(Status(kAnn).ok());
}

TEST_F(LimitsTest, RequestsASecondOfAWorker) {
  StartGate({.requests_per_second = 1,
             .request_burst = 1,
             .worker_requests_per_second = 10,
             .worker_request_burst = 3});
  const auto fetch = [this] {
    const auto context = As("worker/node-7");
    v1::JobSpec spec;
    spec.mutable_planning()->set_mode(v1::PLAN_MODE_FULL);
    return workers().FetchSpec(context.get(), v1::FetchSpecRequest(), &spec);
  };
  for (int i = 0; i < 3; ++i) EXPECT_EQ(fetch().error_code(), grpc::StatusCode::NOT_FOUND);
  const grpc::Status refused = fetch();
  EXPECT_EQ(refused.error_code(), grpc::StatusCode::UNAVAILABLE);
  EXPECT_EQ(refused.error_message(), "too many requests: a caller may make 10 a second");
  Advance(absl::Milliseconds(100));
  EXPECT_EQ(fetch().error_code(), grpc::StatusCode::NOT_FOUND);
}

TEST_F(LimitsTest, WhoeverIsRefusedAgainAndAgainIsShutOut) {
  StartGate({.requests_per_second = 1, .request_burst = 1});
  EXPECT_TRUE(Status(kAnn).ok());
  for (int i = 0; i < 100; ++i) EXPECT_FALSE(Status(kAnn).ok());
  EXPECT_EQ(shut_out_, 0);
  EXPECT_FALSE(Status(kAnn).ok());
  EXPECT_EQ(shut_out_, 1);
  Advance(absl::Seconds(1));
  EXPECT_TRUE(Status(kAnn).ok());
  for (int i = 0; i < 10; ++i) EXPECT_FALSE(Status(kAnn).ok());
  EXPECT_EQ(shut_out_, 1) << "ten a second are borne";
}

TEST_F(LimitsTest, OpenStreams) {
  StartGate({.streams_per_person = 2});
  StoreScene();
  std::string job;
  ASSERT_TRUE(SubmitAs(kAnn, "watched", "", &job).ok());
  v1::WatchJobRequest request;
  request.set_job_id(job);
  v1::JobStatus status;
  std::vector<std::unique_ptr<grpc::ClientContext>> contexts;
  std::vector<std::unique_ptr<grpc::ClientReader<v1::JobStatus>>> readers;
  for (int i = 0; i < 3; ++i) {
    contexts.push_back(As(kAnn));
    readers.push_back(farm().WatchJob(contexts.back().get(), request));
    EXPECT_EQ(readers.back()->Read(&status), i < 2);
  }
  const grpc::Status refused = readers.back()->Finish();
  EXPECT_EQ(refused.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(refused.error_message(), "too many streams are open: a caller may have 2");
  readers.pop_back();
  for (size_t i = 0; i < readers.size(); ++i) {
    contexts[i]->TryCancel();
    readers[i]->Finish();
  }
  Await([&] {  // the places are free again
    const auto context = As(kAnn);
    const auto reader = farm().WatchJob(context.get(), request);
    const bool open = reader->Read(&status);
    context->TryCancel();
    reader->Finish();
    return open;
  });
}

TEST_F(LimitsTest, ActiveJobsOfAUser) {
  StartGate({}, {.jobs_per_user = 2});
  StoreScene();
  std::string first;
  EXPECT_TRUE(SubmitAs(kAnn, "1", "", &first).ok());
  EXPECT_TRUE(SubmitAs(kAnn, "2", "", nullptr).ok());
  const grpc::Status refused = SubmitAs(kAnn, "3", "", nullptr);
  EXPECT_EQ(refused.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(refused.error_message(), "user \"ann\" has 2 active jobs; the limit is 2");
  EXPECT_TRUE(SubmitAs(kBob, "4", "", nullptr).ok());
  coordinator_->changes().CancelJob(first, [](const absl::StatusOr<v1::JobStatus>&) {});
  EXPECT_TRUE(SubmitAs(kAnn, "5", "", nullptr).ok());
}

TEST_F(LimitsTest, ARepeatedSubmissionGetsItsJobWhateverIsFull) {
  StartGate({}, {.jobs_per_user = 1});
  StoreScene();
  std::string first;
  ASSERT_TRUE(SubmitAs(kAnn, "1", "", &first).ok());
  EXPECT_EQ(SubmitAs(kAnn, "2", "", nullptr).error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  std::string repeated;
  const grpc::Status again = SubmitAs(kAnn, "1", "", &repeated);
  EXPECT_TRUE(again.ok()) << again.error_message();
  EXPECT_EQ(repeated, first);
  std::filesystem::remove_all(data_.AssetsPath());  // of its scene
  EXPECT_TRUE(SubmitAs(kAnn, "1", "", &repeated).ok());
  EXPECT_EQ(repeated, first);
  EXPECT_EQ(SubmitAs(kAnn, "2", "", nullptr).error_code(), grpc::StatusCode::FAILED_PRECONDITION);
}

TEST_F(LimitsTest, BytesOfAJobsFiles) {
  StartGate({}, {.job_asset_bytes = 30});
  StoreScene();  // of 20 bytes
  v1::SubmitJobRequest request;
  *request.mutable_spec() = Spec();
  request.set_request_id("large");
  v1::AssetRef* dependency = request.mutable_spec()->mutable_scene()->add_dependencies();
  *dependency = request.spec().scene().file();
  dependency->set_uri("wood.png");
  dependency->set_size(1);  // what the client says does not count
  v1::SubmitJobResponse response;
  const grpc::Status refused = Call(kAnn, &Stub::SubmitJob, request, &response);
  EXPECT_EQ(refused.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(refused.error_message(), "the files of the scene have 40 bytes; the limit of a job is 30");
}

TEST_F(LimitsTest, BytesOfOneFile) {
  StartGate();
  AssetStore assets(data_.AssetsPath(), data_.IncomingPath(), nullptr, &files_,
                    AssetLimits{.asset_bytes = 100});
  v1::AssetRef asset;
  asset.set_uri("wood.png");
  asset.set_sha256(std::string(64, 'a'));
  asset.set_size(101);
  const absl::Status refused = assets.Receive(asset, "ann").status();
  EXPECT_EQ(refused.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(refused.message(), "asset 'wood.png': its size is 101, more than 100");
}

TEST_F(LimitsTest, TwentyAnnouncementsOfATebibyteAreRefusedAtOnce) {
  StartGate();
  for (int i = 0; i < 20; ++i) {
    const grpc::Status refused = EndOf(Announce(kAnn, i, uint64_t{1} << 40));
    EXPECT_EQ(refused.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED) << refused.error_message();
  }
}

TEST_F(LimitsTest, UploadsThatAreAnnouncedAndNotComplete) {
  StartGate();
  const UploadLimits limits;
  for (int i = 0; i < limits.uploads_of_caller; ++i) Announce(kAnn, i, 1000);
  // The announcements come one after the other, but each on its own stream.
  Await([&] {
    const grpc::Status refused = [&] {
      HalfUpload* upload = Announce(kAnn, 100, 1000);
      upload->writer->WritesDone();
      return EndOf(upload);
    }();
    return refused.error_code() == grpc::StatusCode::RESOURCE_EXHAUSTED;
  });
  HalfUpload* of_bob = Announce(kBob, 101, 3);
  of_bob->writer->WritesDone();
  EXPECT_EQ(EndOf(of_bob).error_code(), grpc::StatusCode::DATA_LOSS) << "bob may announce; he sent nothing";
}

TEST_F(LimitsTest, AnUploadThatStallsLosesItsPlace) {
  StartGate({.stalled_stream = absl::Seconds(10)});
  std::vector<HalfUpload*> stalled;
  const UploadLimits limits;
  stalled.reserve(static_cast<size_t>(limits.uploads_of_caller));
  for (int i = 0; i < limits.uploads_of_caller; ++i) stalled.push_back(Announce(kAnn, i, 1000));
  size_t ended = 0;
  Await([&] {  // each stream waits from the moment at which its announcement was taken
    Advance(absl::Seconds(10));
    ended += EndStalledStreams();
    return ended == stalled.size();
  });
  for (HalfUpload* upload : stalled) {
    const grpc::Status end = EndOf(upload);
    EXPECT_EQ(end.error_code(), grpc::StatusCode::DEADLINE_EXCEEDED);
    EXPECT_EQ(end.error_message(),
              "the stream has stalled: its other end neither sent nor took a message for 10s, or fewer than "
              "1048576 bytes of a file");
  }
  Await([&] {  // the places are free again
    HalfUpload* upload = Announce(kAnn, 100, 1000);
    upload->writer->WritesDone();
    return EndOf(upload).error_code() == grpc::StatusCode::DATA_LOSS;
  });
}

TEST_F(LimitsTest, AnUploadOfAFewBytesNowAndThenLosesItsPlace) {
  StartGate({.stalled_stream = absl::Seconds(10), .stalled_file_bytes = 1000});
  HalfUpload* upload = AwaitUpload();
  uint64_t sent = 0;
  EXPECT_EQ(Drip(100, absl::Seconds(3), [&] { Send(upload, &sent, 10); }), 4) << "a message every 3 s";
  EXPECT_EQ(EndOf(upload).error_code(), grpc::StatusCode::DEADLINE_EXCEEDED);
}

TEST_F(LimitsTest, AnUploadThatKeepsItsPaceKeepsItsPlace) {
  StartGate({.stalled_stream = absl::Seconds(10), .stalled_file_bytes = 1000});
  HalfUpload* upload = AwaitUpload();
  uint64_t sent = 0;
  EXPECT_EQ(Drip(100, absl::Seconds(3), [&] { Send(upload, &sent, 400); }), 100);
}

TEST_F(LimitsTest, ADownloadThatDoesNotReadLosesItsPlace) {
  StartGate({.streams_per_person = 1, .stalled_stream = absl::Seconds(10)});
  FinishJob(1);
  const auto reader = Download();
  AwaitStall();
  v1::ByteChunk chunk;
  while (reader->Read(&chunk)) {
  }
  EXPECT_EQ(reader->Finish().error_code(), grpc::StatusCode::CANCELLED);
  Await([&] {  // the place is free again
    const auto again = Download();
    while (again->Read(&chunk)) {
    }
    return again->Finish().ok();
  });
}

TEST_F(LimitsTest, ADownloadThatReadsTooSlowlyLosesItsPlace) {
  StartGate({.stalled_stream = absl::Seconds(10), .stalled_file_bytes = 3 * rpc::kMaxChunkBytes});
  FinishJob(20);
  const auto reader = AwaitDownload();
  v1::ByteChunk chunk;
  EXPECT_EQ(Drip(19, absl::Seconds(5), [&] { reader->Read(&chunk); }), 2) << "a chunk every 5 s";
  while (reader->Read(&chunk)) {
  }
  EXPECT_EQ(reader->Finish().error_code(), grpc::StatusCode::CANCELLED);
}

TEST_F(LimitsTest, ADownloadThatKeepsItsPaceKeepsItsPlace) {
  StartGate({.stalled_stream = absl::Seconds(10), .stalled_file_bytes = 3 * rpc::kMaxChunkBytes});
  FinishJob(20);
  const auto reader = AwaitDownload();
  v1::ByteChunk chunk;
  EXPECT_EQ(Drip(19, absl::Seconds(3), [&] { reader->Read(&chunk); }), 19) << "a chunk every 3 s";
  EXPECT_TRUE(reader->Read(&chunk));
  EXPECT_FALSE(reader->Read(&chunk));
  EXPECT_TRUE(reader->Finish().ok());
}

TEST_F(LimitsTest, AWatcherThatDoesNotReadLosesItsPlace) {
  StartGate({.streams_per_person = 1, .stalled_stream = absl::Seconds(10)});
  StoreScene();
  std::string job;
  ASSERT_TRUE(SubmitAs(kAnn, "watched", "", &job).ok());
  v1::WatchJobRequest request;
  request.set_job_id(job);
  const auto context = As(kAnn);
  const auto reader = farm().WatchJob(context.get(), request);
  AwaitStall();
  v1::JobStatus status;
  while (reader->Read(&status)) {
  }
  EXPECT_EQ(reader->Finish().error_code(), grpc::StatusCode::CANCELLED);
}

TEST_F(LimitsTest, AWatcherOfAQuietJobHasNotStalled) {
  StartGate({.stalled_stream = absl::Seconds(10)});
  StoreScene();
  std::string job;
  ASSERT_TRUE(SubmitAs(kAnn, "watched", "", &job).ok());
  v1::WatchJobRequest request;
  request.set_job_id(job);
  const auto context = As(kAnn);
  const auto reader = farm().WatchJob(context.get(), request);
  v1::JobStatus status;
  ASSERT_TRUE(reader->Read(&status));
  // Until the coordinator has noticed that the message was taken.
  Await([&] { return open_calls_.waiting() == 0; });
  Advance(absl::Hours(1));
  EXPECT_EQ(EndStalledStreams(), 0u);
  context->TryCancel();
  reader->Finish();
}

TEST_F(LimitsTest, AWorkerThatSaysNothingIsDisconnected) {
  StartGate({.stalled_stream = absl::Seconds(10)});
  const auto context = As("worker/node-7");
  const auto stream = workers().Work(context.get());
  v1::WorkerMessage message;
  message.mutable_hello()->set_name("node-7");
  message.mutable_hello()->set_numeric_class("test");
  message.mutable_hello()->set_slots(1);
  message.mutable_hello()->set_wire_version(rpc::kWireVersion);
  stream->Write(message);
  v1::CoordinatorMessage answer;
  ASSERT_TRUE(stream->Read(&answer));
  AwaitStall();
  EXPECT_FALSE(stream->Read(&answer));
  // Cancelled where the coordinator has not yet learnt that Welcome was read.
  EXPECT_THAT(stream->Finish().error_code(),
              AnyOf(grpc::StatusCode::DEADLINE_EXCEEDED, grpc::StatusCode::CANCELLED));
  Await([&] { return coordinator_->operators().ListWorkers({})->workers_size() == 0; });
}

TEST_F(LimitsTest, BytesOfAMessage) {
  StartGate();
  v1::FindMissingAssetsRequest request;
  request.add_assets()->set_uri(std::string(rpc::kMaxMessageBytes, 'x'));
  v1::FindMissingAssetsResponse response;
  const grpc::Status refused = Call(kAnn, &Stub::FindMissingAssets, request, &response);
  EXPECT_EQ(refused.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_THAT(refused.error_message(), HasSubstr(absl::StrCat("vs. ", rpc::kMaxMessageBytes)));
}

}  // namespace
}  // namespace lumifold::server
