// A frame that a worker finishes: the same file as the coordinator's.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "absl/types/span.h"
#include "proto/rpc/checksum.h"
#include "proto/rpc/limits.h"
#include "proto/rpc/sha256.h"
#include "server/commit/unit_sender.h"
#include "server/film/unit_film.h"
#include "server/finish/estimate_round.h"
#include "server/finish/finish_frame.h"
#include "server/picture/filtered_round.h"
#include "server/picture/make_picture.h"
#include "tests/unit/server/committed_frame_fixture.h"
#include "worker/finish/finish_frame.h"
#include "worker/finish/memory_files.h"

namespace lumifold::server {
namespace {

using job::JobId;
using ::testing::HasSubstr;

/// A coordinator without a network.
class LocalLink final : public worker::FrameLink {
 public:
  explicit LocalLink(std::function<CommittedUnits()> open) : open_(std::move(open)) {}

  absl::Status FetchUnits(const v1::Lease& /*lease*/,
                          absl::FunctionRef<absl::Status(const v1::ByteChunk&)> take) override {
    UnitSender sender(open_(), film_levels, rounds);
    v1::ByteChunk chunk;
    while (true) {
      const absl::StatusOr<bool> has_next = sender.Next(&chunk);
      if (!has_next.ok()) return has_next.status();
      if (!*has_next) return absl::OkStatus();
      if (damage != nullptr) damage(&chunk);
      if (absl::Status status = take(chunk); !status.ok()) return status;
    }
  }
  absl::Status DeliverResult(const v1::Lease& /*lease*/, const v1::FrameReport& made,
                             absl::FunctionRef<absl::StatusOr<bool>(v1::ByteChunk*)> next) override {
    report = made;
    v1::ByteChunk chunk;
    while (true) {
      const absl::StatusOr<bool> has_next = next(&chunk);
      if (!has_next.ok()) return has_next.status();
      if (!*has_next) return absl::OkStatus();
      if (delivered.empty()) sha256 = chunk.sha256();
      delivered += chunk.data();
    }
  }

  std::function<void(v1::ByteChunk*)> damage;
  uint64_t film_levels = 0;
  std::string rounds;
  std::string delivered;
  std::string sha256;
  v1::FrameReport report;

 private:
  const std::function<CommittedUnits()> open_;
};

class WorkerFinishTest : public CommittedFrameFixture {
 protected:
  WorkerFinishTest() { Commit(job_, Spec(60, 44)); }

  absl::Status Finish(const ledger::JobRecord& job) {
    v1::Lease lease;
    lease.mutable_unit()->set_job_id(job_.value());
    lease.mutable_unit()->set_kind(v1::UNIT_KIND_RESULT);
    return worker::FinishFrame(job.spec, lease, rpc::FileHandle(),
                               {.link = &link_, .numeric_class = job.numeric_class}, &control_);
  }
  absl::Status Finish() { return Finish(*store_->GetJob(job_)); }

  const JobId job_{"j-1"};
  LocalLink link_{[this] { return *CommittedUnits::Open(folder_, *store_, *store_->GetJob(job_), 0); }};
  worker::UnitControl control_;
};

TEST_F(WorkerFinishTest, DeliversTheBytesThatTheCoordinatorWouldWrite) {
  ASSERT_TRUE(FinishFrame(folder_, *store_, {job_, {}}, 0, nullptr, [] { return absl::Now(); }).ok());
  const absl::Status finished = Finish();
  ASSERT_TRUE(finished.ok()) << finished;
  EXPECT_EQ(link_.delivered, Result(job_));
  EXPECT_EQ(link_.sha256, rpc::Sha256Hex(link_.delivered));
  EXPECT_GT(link_.report.times().filter_seconds(), 0);
  EXPECT_GE(control_.progress, 3);
  EXPECT_GT(control_.filtered, 0.5);
}

TEST_F(WorkerFinishTest, MakesTheSameOfUnitsThatItHasKept) {
  ASSERT_TRUE(FinishFrame(folder_, *store_, {job_, {}}, 0, nullptr, [] { return absl::Now(); }).ok());
  std::string records;
  ASSERT_TRUE(link_
                  .FetchUnits({},
                              [&](const v1::ByteChunk& chunk) {
                                records += chunk.data();
                                return absl::OkStatus();
                              })
                  .ok());
  worker::MemoryFiles files;
  rpc::FileHandle kept(files.Open("kept", O_RDWR));
  ASSERT_EQ(files.Write(kept.get(), 0, {records}), 0);
  link_.damage = [](v1::ByteChunk*) { ADD_FAILURE() << "nothing is fetched"; };
  const ledger::JobRecord job = *store_->GetJob(job_);
  v1::Lease lease;
  lease.mutable_unit()->set_kind(v1::UNIT_KIND_RESULT);
  lease.set_keep(true);
  const absl::Status finished = worker::FinishFrame(
      job.spec, lease, std::move(kept), {.link = &link_, .numeric_class = job.numeric_class}, &control_);
  ASSERT_TRUE(finished.ok()) << finished;
  EXPECT_EQ(link_.delivered, Result(job_));
}

TEST_F(WorkerFinishTest, DeliversABlockOfALargeFrame) {
  const JobId job("j-wide");
  Commit(job, Spec(4104, 8));  // longer than a block may be
  const ledger::JobRecord record = *store_->GetJob(job);
  const CommittedUnits units = *CommittedUnits::Open(folder_, *store_, record, 0);
  const film::LevelSet levels = film::UnitFilm::Open(record.spec, 0, &units, nullptr)->levels();
  const FrameBlocks blocks(record.spec);
  ASSERT_EQ(blocks.count(), 4);
  LocalLink link([&] {
    CommittedUnits kept = *CommittedUnits::Open(folder_, *store_, record, 0);
    kept.KeepTiles(job::FrameUnits(record.spec).tiles().TilesIn(blocks.Input(3)));
    return kept;
  });
  link.film_levels = levels.to_ullong();
  v1::Lease lease;
  lease.mutable_unit()->set_job_id(job.value());
  lease.mutable_unit()->set_kind(v1::UNIT_KIND_BLOCK);
  lease.mutable_unit()->set_tile(3);
  const absl::Status finished =
      worker::FinishFrame(record.spec, lease, rpc::FileHandle(),
                          {.link = &link, .numeric_class = record.numeric_class}, &control_);
  ASSERT_TRUE(finished.ok()) << finished;
  EXPECT_EQ(link.delivered,
            *MakeBlock({.spec = record.spec, .numeric_class = "", .units = units}, 3, levels, nullptr));
  const absl::StatusOr<v1::FrameReport> here =
      FilterBlock(folder_, *store_, {job, {}}, 0, 3, nullptr, [] { return absl::Now(); });
  ASSERT_TRUE(here.ok()) << here.status();
  std::ifstream file(folder_.BlockPath(job, 0, 3), std::ios::binary);
  EXPECT_TRUE(std::string(std::istreambuf_iterator<char>(file), {}) == link.delivered);
  lease.mutable_unit()->set_tile(4);
  EXPECT_EQ(worker::FinishFrame(record.spec, lease, rpc::FileHandle(),
                                {.link = &link, .numeric_class = record.numeric_class}, &control_)
                .code(),
            absl::StatusCode::kInvalidArgument);
}

/// A frame whose three first rounds reach the target.
class AdaptiveFinishTest : public CommittedFrameFixture {
 protected:
  AdaptiveFinishTest() {
    v1::JobSpec spec = Spec(24, 16);
    spec.set_samples_per_pixel(400);
    spec.set_pass_samples(64);
    spec.mutable_adaptive()->set_target_error(1e9);
    Commit(job_, spec, /*is_forward=*/true,
           [](const job::UnitKey& key) { return key.kind != v1::UNIT_KIND_PASS || key.pass <= 2; });
    record_ = *store_->GetJob(job_);
    blocks_ = ErrorBytesOf(record_.spec) / sizeof(double);
  }

  absl::Status Finish(v1::UnitKind kind, int round = 0) {
    link_.rounds = Rounds().SerializeAsString();
    v1::Lease lease;
    lease.mutable_unit()->set_job_id(job_.value());
    lease.mutable_unit()->set_kind(kind);
    lease.mutable_unit()->set_pass(round);
    return worker::FinishFrame(record_.spec, lease, rpc::FileHandle(),
                               {.link = &link_, .numeric_class = record_.numeric_class}, &control_);
  }
  /// By the coordinator; `filtered`: a worker has done that.
  absl::Status Estimate(int round, bool filtered = false) {
    RoundToEstimate what = {.job = job_, .epoch = {}, .frame = 0, .round = round};
    if (filtered) what.filtered = absl::Seconds(1);
    return EstimateRound(folder_, *store_, what, nullptr, [] { return absl::Now(); }).status();
  }
  v1::RoundEstimates Rounds() const { return *ReadEstimates(folder_.RoundsPath(job_, 0)); }
  std::vector<double> ErrorsOfRound(int round) const {
    const v1::RoundEstimate estimate = Rounds().estimates(round - 1);
    return {estimate.errors().begin(), estimate.errors().end()};
  }
  void Write(const std::string& errors, int round) const {
    EXPECT_TRUE(MakeFolder(folder_.ResultsPath(job_)).ok());
    std::ofstream(ErrorsPath(folder_, job_, 0, round), std::ios::binary) << errors;
  }

  const JobId job_{"j-1"};
  ledger::JobRecord record_;
  size_t blocks_ = 0;
  LocalLink link_{[this] { return *CommittedUnits::Open(folder_, *store_, record_, 0); }};
  worker::UnitControl control_;
};

TEST_F(AdaptiveFinishTest, EstimatesAndResultAreThoseOfTheCoordinator) {
  for (const int round : {1, 2}) {
    link_.delivered.clear();
    const absl::Status estimated = Finish(v1::UNIT_KIND_ESTIMATE, round);
    ASSERT_TRUE(estimated.ok()) << estimated;
    EXPECT_GT(link_.report.times().filter_seconds(), 0);
    ASSERT_TRUE(Estimate(round).ok());
    EXPECT_TRUE(link_.delivered == BytesOfErrors(ErrorsOfRound(round))) << round;
  }
  link_.delivered.clear();
  const absl::StatusOr<v1::FrameReport> report =
      FinishFrame(folder_, *store_, {job_, {}}, 0, nullptr, [] { return absl::Now(); });
  ASSERT_TRUE(report.ok()) << report.status();
  const absl::Status finished = Finish(v1::UNIT_KIND_RESULT);
  ASSERT_TRUE(finished.ok()) << finished;
  EXPECT_TRUE(link_.delivered == Result(job_));
  EXPECT_TRUE(report->has_estimated_error());
  EXPECT_EQ(link_.report.estimated_error(), report->estimated_error());
}

TEST_F(AdaptiveFinishTest, TheCoordinatorTakesTheErrorsOfAWorkerWhereTheyAreWhole) {
  Write(BytesOfErrors(std::vector<double>(blocks_, 0.25)), 1);
  ASSERT_TRUE(Estimate(1, /*filtered=*/true).ok());
  EXPECT_EQ(ErrorsOfRound(1), std::vector<double>(blocks_, 0.25));
  Write("too short", 2);
  ASSERT_TRUE(Estimate(2, /*filtered=*/true).ok());
  EXPECT_EQ(ErrorsOfRound(2).size(), blocks_);
  EXPECT_EQ(ErrorsOfBytes(std::string(8, '\xff'), 1).status().code(), absl::StatusCode::kDataLoss)
      << "not a number";
}

TEST_F(AdaptiveFinishTest, ARecordOfRoundsThatIsDamagedIsNotUsed) {
  link_.damage = [](v1::ByteChunk* chunk) { chunk->set_rounds_bytes(chunk->rounds_bytes() + 7); };
  EXPECT_EQ(Finish(v1::UNIT_KIND_RESULT).code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(Finish(v1::UNIT_KIND_ESTIMATE, 3).code(), absl::StatusCode::kDataLoss);
  link_.damage = nullptr;
  EXPECT_EQ(Finish(v1::UNIT_KIND_ESTIMATE, 3).code(), absl::StatusCode::kInvalidArgument) << "no such round";
  EXPECT_EQ(link_.delivered, "");
}

TEST_F(WorkerFinishTest, UnitsThatAreDamagedOnTheirWayAreNotUsed) {
  link_.damage = [](v1::ByteChunk* chunk) { (*chunk->mutable_data())[1000] ^= 1; };
  EXPECT_EQ(Finish().code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(link_.delivered, "");
}

TEST_F(WorkerFinishTest, ARecordThatIsDamagedIsNamed) {
  link_.damage = [](v1::ByteChunk* chunk) {
    (*chunk->mutable_data())[chunk->data().size() - 1] ^= 1;
    chunk->set_checksum(rpc::Checksum(chunk->data()));
  };
  EXPECT_THAT(std::string(Finish().message()), HasSubstr("units of frame 0: record at "));
  EXPECT_EQ(link_.delivered, "");
}

TEST_F(WorkerFinishTest, AFrameThatLacksAUnitIsNotFinished) {
  ledger::JobRecord job = *store_->GetJob(job_);
  job.spec.set_samples_per_pixel(40);
  EXPECT_EQ(Finish(job).code(), absl::StatusCode::kDataLoss);
}

TEST_F(WorkerFinishTest, AFrameThatIsNoLongerWantedIsDropped) {
  control_.stop = true;
  EXPECT_EQ(Finish().code(), absl::StatusCode::kCancelled);
  EXPECT_EQ(link_.delivered, "");
}

/// Records of more bytes than two pieces, in two logs.
class UnitSenderTest : public CommittedFrameFixture {
 protected:
  UnitSenderTest() {
    logs_ = 2;
    v1::JobSpec spec = Spec(192, 128);
    spec.set_tile_size(64);
    Commit(job_, spec);
  }
  CommittedUnits Open() const { return *CommittedUnits::Open(folder_, *store_, *store_->GetJob(job_), 0); }

  const JobId job_{"j-1"};
};

TEST_F(UnitSenderTest, SendsEachRecordOnceInFullPieces) {
  const CommittedUnits units = Open();
  UnitSender sender(Open());
  std::string sent;
  v1::ByteChunk chunk;
  while (*sender.Next(&chunk)) {
    EXPECT_EQ(chunk.offset(), sent.size());
    EXPECT_EQ(chunk.total_size(), units.record_bytes());
    EXPECT_EQ(chunk.checksum(), rpc::Checksum(chunk.data()));
    sent += chunk.data();
    EXPECT_EQ(chunk.data().size(),
              std::min<uint64_t>(rpc::kMaxChunkBytes, chunk.total_size() - chunk.offset()));
  }
  EXPECT_GT(sent.size(), 2 * rpc::kMaxChunkBytes);
  std::string records;
  for (int64_t number = 0; number < units.places(); ++number) {
    std::string record(units.record_bytes(number), '\0');
    ASSERT_TRUE(units.ReadRecord(number, 0, absl::MakeSpan(record)).ok());
    records += record;
  }
  EXPECT_EQ(sent, records);
}

TEST_F(UnitSenderTest, NamesALogThatHasBecomeShorter) {
  UnitSender sender(Open());
  const std::string log = folder_.PathOf(folder_.UnitLogName(job_, 0));
  std::filesystem::resize_file(log, std::filesystem::file_size(log) / 2);
  v1::ByteChunk chunk;
  absl::StatusOr<bool> has_next = true;
  while (has_next.ok() && *has_next) has_next = sender.Next(&chunk);
  EXPECT_EQ(has_next.status().code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(std::string(has_next.status().message()), HasSubstr(log));
}

}  // namespace
}  // namespace lumifold::server
