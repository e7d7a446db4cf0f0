#include "server/assets/asset_store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "proto/rpc/checksum.h"
#include "proto/rpc/limits.h"
#include "proto/rpc/sha256.h"
#include "server/assets/upload_budget.h"
#include "server/job/limits.h"
#include "server/storage/data_folder.h"
#include "tests/support/temp_folder.h"

namespace lumifold::server {
namespace {

using ::testing::HasSubstr;

class AssetStoreTest : public ::testing::Test {
 protected:
  AssetStoreTest() {
    EXPECT_TRUE(MakeFolder(folder_.PathOf("assets")).ok());
    EXPECT_TRUE(MakeFolder(folder_.PathOf("incoming")).ok());
  }

  static v1::AssetRef Announce(const std::string& content) {
    v1::AssetRef asset;
    asset.set_uri("wood.png");
    asset.set_sha256(rpc::Sha256Hex(content));
    asset.set_size(content.size());
    return asset;
  }

  static v1::ByteChunk Chunk(const std::string& content) {
    v1::ByteChunk chunk;
    chunk.set_data(content);
    chunk.set_checksum(rpc::Checksum(content));
    chunk.set_total_size(content.size());
    return chunk;
  }

  static v1::ByteChunk Piece(const std::string& content, size_t offset, size_t size) {
    v1::ByteChunk chunk = Chunk(content.substr(offset, size));
    chunk.set_offset(offset);
    chunk.set_total_size(content.size());
    return chunk;
  }

  bool NothingIncoming() const { return std::filesystem::is_empty(folder_.PathOf("incoming")); }

  TempFolder folder_;
  AssetStore store_{folder_.PathOf("assets"), folder_.PathOf("incoming")};
};

TEST_F(AssetStoreTest, KeepsWhatHasTheSumAnnounced) {
  const v1::AssetRef asset = Announce("oak");
  for (int repeat = 0; repeat < 2; ++repeat) {
    absl::StatusOr<std::unique_ptr<AssetUpload>> upload = store_.Receive(asset, "ann");
    ASSERT_TRUE(upload.ok());
    ASSERT_TRUE((*upload)->Add(Chunk("oak")).ok());
    EXPECT_EQ(store_.Has(asset.sha256()), repeat == 1);
    EXPECT_TRUE((*upload)->Finish().ok());
  }
  v1::ByteChunk chunk;
  absl::StatusOr<rpc::ByteSender> sender = store_.Open(asset.sha256(), 1);
  ASSERT_TRUE(sender.ok());
  EXPECT_TRUE(*sender->Next(&chunk));
  EXPECT_EQ(chunk.data(), "ak");
  EXPECT_TRUE(NothingIncoming());
}

TEST_F(AssetStoreTest, KeepsAnEmptyAsset) {
  const v1::AssetRef asset = Announce("");
  absl::StatusOr<std::unique_ptr<AssetUpload>> upload = store_.Receive(asset, "ann");
  ASSERT_TRUE((*upload)->Add(Chunk("")).ok());
  EXPECT_TRUE((*upload)->Finish().ok());
  EXPECT_TRUE(store_.Has(asset.sha256()));
}

TEST_F(AssetStoreTest, AnotherContentIsNotKept) {
  const v1::AssetRef asset = Announce("oak");
  {
    absl::StatusOr<std::unique_ptr<AssetUpload>> upload = store_.Receive(asset, "ann");
    ASSERT_TRUE((*upload)->Add(Chunk("elm")).ok());
    const absl::Status status = (*upload)->Finish();
    EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss);
    EXPECT_THAT(std::string(status.message()), HasSubstr("wood.png"));
  }
  EXPECT_FALSE(store_.Has(asset.sha256()));
  EXPECT_TRUE(NothingIncoming());
}

TEST_F(AssetStoreTest, AnotherSizeIsRefusedAtOnce) {
  absl::StatusOr<std::unique_ptr<AssetUpload>> upload = store_.Receive(Announce("oak"), "ann");
  EXPECT_EQ((*upload)->Add(Chunk("chestnut")).code(), absl::StatusCode::kDataLoss);
}

TEST_F(AssetStoreTest, ADamagedAssetIsMovedAsideAndHealedByAnUpload) {
  const v1::AssetRef asset = Announce("oak");
  const std::string path = folder_.PathOf("assets/" + asset.sha256());
  std::ofstream(path, std::ios::binary) << "oal";  // a flipped bit
  EXPECT_EQ(store_.Open(asset.sha256(), 0).status().code(), absl::StatusCode::kNotFound);
  EXPECT_FALSE(store_.Has(asset.sha256()));
  EXPECT_FALSE(std::filesystem::exists(path));
  EXPECT_TRUE(std::filesystem::exists(path + ".damaged"));
  absl::StatusOr<std::unique_ptr<AssetUpload>> upload = store_.Receive(asset, "ann");
  ASSERT_TRUE((*upload)->Add(Chunk("oak")).ok());
  ASSERT_TRUE((*upload)->Finish().ok());
  EXPECT_TRUE(store_.Has(asset.sha256()));
  EXPECT_TRUE(store_.Open(asset.sha256(), 0).ok());
}

TEST_F(AssetStoreTest, ACutAssetIsDamagedToo) {
  const v1::AssetRef asset = Announce("oak");
  std::ofstream(folder_.PathOf("assets/" + asset.sha256()));
  EXPECT_FALSE(store_.Has(asset.sha256()));
}

TEST_F(AssetStoreTest, AnAssetOfSeveralPiecesIsReadToItsEnd) {
  std::string content(2 * rpc::kMaxChunkBytes + 10, 'w');
  const std::string sha256 = rpc::Sha256Hex(content);
  std::ofstream(folder_.PathOf("assets/" + sha256), std::ios::binary) << content;
  EXPECT_TRUE(store_.Has(sha256));
  content.back() = 'v';
  std::ofstream(folder_.PathOf("assets/" + sha256), std::ios::binary) << content;
  AssetStore next(folder_.PathOf("assets"), folder_.PathOf("incoming"));
  EXPECT_FALSE(next.Has(sha256));
}

TEST_F(AssetStoreTest, AnAssetIsReadOnceAfterTheStart) {
  const v1::AssetRef asset = Announce("oak");
  const std::string path = folder_.PathOf("assets/" + asset.sha256());
  std::ofstream(path, std::ios::binary) << "oak";
  std::vector<std::thread> threads;
  std::atomic<int> present{0};
  for (int i = 0; i < 4; ++i) threads.emplace_back([&] { present += store_.Has(asset.sha256()) ? 1 : 0; });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(present, 4);
  std::ofstream(path, std::ios::binary) << "oal";  // found by the next start
  EXPECT_TRUE(store_.Has(asset.sha256()));
  AssetStore next(folder_.PathOf("assets"), folder_.PathOf("incoming"));
  EXPECT_FALSE(next.Has(asset.sha256()));
}

TEST_F(AssetStoreTest, ABrokenUploadGoesOnWhereItStopped) {
  const v1::AssetRef asset = Announce("oak and elm");
  EXPECT_EQ(store_.ReceivedBytes(asset.sha256()), 0u);
  {
    absl::StatusOr<std::unique_ptr<AssetUpload>> upload = store_.Receive(asset, "ann");
    ASSERT_TRUE((*upload)->Add(Piece("oak and elm", 0, 3)).ok());
    EXPECT_THAT(std::string((*upload)->Finish().message()), HasSubstr("only 3 of 11 bytes"));
  }
  EXPECT_FALSE(store_.Has(asset.sha256()));
  EXPECT_EQ(store_.ReceivedBytes(asset.sha256()), 3u);
  absl::StatusOr<std::unique_ptr<AssetUpload>> upload = store_.Receive(asset, "ann");
  ASSERT_TRUE((*upload)->Add(Piece("oak and elm", 3, 8)).ok());
  EXPECT_TRUE((*upload)->Finish().ok());
  EXPECT_TRUE(store_.Has(asset.sha256()));
  EXPECT_TRUE(NothingIncoming());
}

TEST_F(AssetStoreTest, AnUploadOfAKilledCoordinatorGoesOn) {
  const v1::AssetRef asset = Announce("oak and elm");
  std::ofstream(folder_.PathOf("incoming/" + asset.sha256() + ".7")) << "oak ";
  std::ofstream(folder_.PathOf("incoming/" + asset.sha256() + ".8")) << "oak an";
  std::ofstream(folder_.PathOf("incoming/" + asset.sha256() + ".9")) << "oa";
  AssetStore store(folder_.PathOf("assets"), folder_.PathOf("incoming"));
  EXPECT_EQ(store.ReceivedBytes(asset.sha256()), 6u);
  absl::StatusOr<std::unique_ptr<AssetUpload>> upload = store.Receive(asset, "ann");
  ASSERT_TRUE((*upload)->Add(Piece("oak and elm", 6, 5)).ok());
  EXPECT_TRUE((*upload)->Finish().ok());
  EXPECT_TRUE(NothingIncoming());
}

TEST_F(AssetStoreTest, AnUploadThatIsGoneCannotGoOn) {
  const v1::AssetRef asset = Announce("oak and elm");
  absl::StatusOr<std::unique_ptr<AssetUpload>> upload = store_.Receive(asset, "ann");
  EXPECT_EQ((*upload)->Add(Piece("oak and elm", 3, 8)).code(), absl::StatusCode::kAborted);
  std::ofstream(folder_.PathOf("incoming/" + asset.sha256() + ".kept")) << "oa";
  EXPECT_EQ((*upload)->Add(Piece("oak and elm", 3, 8)).code(), absl::StatusCode::kAborted);
  EXPECT_EQ(store_.ReceivedBytes(asset.sha256()), 2u);
}

TEST_F(AssetStoreTest, DamagedBytesAreNotKept) {
  const v1::AssetRef asset = Announce("oak and elm");
  std::ofstream(folder_.PathOf("incoming/" + asset.sha256() + ".kept")) << "???";
  {
    absl::StatusOr<std::unique_ptr<AssetUpload>> upload = store_.Receive(asset, "ann");
    ASSERT_TRUE((*upload)->Add(Piece("oak and elm", 3, 8)).ok());
    EXPECT_EQ((*upload)->Finish().code(), absl::StatusCode::kDataLoss);
  }
  EXPECT_EQ(store_.ReceivedBytes(asset.sha256()), 0u);
  EXPECT_TRUE(NothingIncoming());
}

TEST_F(AssetStoreTest, OldUploadsAndThoseOverTheLimitAreRemoved) {
  const auto now = std::filesystem::file_time_type::clock::now();
  for (size_t i = 0; i < kMaxKeptUploads + 2; ++i) {
    const std::string path = folder_.PathOf("incoming/" + rpc::Sha256Hex(std::to_string(i)) + ".kept");
    std::ofstream(path) << "x";
    std::filesystem::last_write_time(path, now - std::chrono::hours(i == 0 ? 25 : 1));
  }
  AssetStore store(folder_.PathOf("assets"), folder_.PathOf("incoming"));
  EXPECT_EQ(store.ReceivedBytes(rpc::Sha256Hex("0")), 0u);
  size_t count = 0;
  for (size_t i = 0; i < kMaxKeptUploads + 2; ++i)
    count += store.ReceivedBytes(rpc::Sha256Hex(std::to_string(i)));
  EXPECT_EQ(count, kMaxKeptUploads);
}

TEST_F(AssetStoreTest, AnUploadThatDoesNotFitIsRefused) {
  uint64_t room = 10;
  AssetStore store(folder_.PathOf("assets"), folder_.PathOf("incoming"));
  store.SetRoom([&room] { return room; });
  const std::string content = "oak and elm";  // 11 bytes
  const v1::AssetRef asset = Announce(content);
  const absl::Status refused = store.Receive(asset, "ann").status();
  EXPECT_EQ(refused.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_THAT(std::string(refused.message()), HasSubstr("wood.png"));
  EXPECT_THAT(std::string(refused.message()), HasSubstr("11 bytes are to come, but there is room for 10"));
  room = 20;
  absl::StatusOr<std::unique_ptr<AssetUpload>> first = store.Receive(asset, "ann");
  EXPECT_FALSE(store.Receive(asset, "ann").ok());  // the first upload needs 11 of the 20 bytes
  ASSERT_TRUE((*first)->Add(Piece(content, 0, 3)).ok());
  room = 17;
  EXPECT_FALSE(store.Receive(asset, "ann").ok());  // it needs 8 of the 17 bytes
  EXPECT_TRUE((*first)->Add(Piece(content, 3, 8)).ok());
  EXPECT_TRUE((*first)->Finish().ok());
  EXPECT_TRUE(store.Receive(asset, "ann").ok());
}

TEST_F(AssetStoreTest, AResumedUploadNeedsRoomForItsRestOnly) {
  uint64_t room = 100;
  AssetStore store(folder_.PathOf("assets"), folder_.PathOf("incoming"));
  store.SetRoom([&room] { return room; });
  const std::string content = "oak and elm";
  const v1::AssetRef asset = Announce(content);
  ASSERT_TRUE((*store.Receive(asset, "ann"))->Add(Piece(content, 0, 8)).ok());
  room = 3;
  absl::StatusOr<std::unique_ptr<AssetUpload>> upload = store.Receive(asset, "ann");
  EXPECT_TRUE((*upload)->Add(Piece(content, 8, 3)).ok());
  EXPECT_TRUE((*upload)->Finish().ok());
}

TEST_F(AssetStoreTest, TheNumberAndSizeOfUploadsIsLimited) {
  std::vector<std::unique_ptr<AssetUpload>> uploads;
  const UploadLimits limits;
  for (int i = 0; i < limits.uploads_of_caller; ++i)
    uploads.push_back(*store_.Receive(Announce("oak"), "ann"));
  EXPECT_EQ(store_.Receive(Announce("oak"), "ann").status().code(), absl::StatusCode::kResourceExhausted);
  uploads.pop_back();
  EXPECT_TRUE(store_.Receive(Announce("oak"), "ann").ok());
  v1::AssetRef huge = Announce("oak");
  huge.set_size(job::kMaxAssetBytes + 1);
  uploads.pop_back();
  EXPECT_EQ(store_.Receive(huge, "ann").status().code(), absl::StatusCode::kInvalidArgument);
}

TEST_F(AssetStoreTest, AssetsThatNobodyUsesAreRemovedAndTheOthersStay) {
  const auto old = std::filesystem::file_time_type::clock::now() -
                   std::chrono::seconds(absl::ToInt64Seconds(kUnusedAssetAge) + 60);
  const auto put = [&](const std::string& content, const std::string& suffix, bool is_old) {
    const std::string path = folder_.PathOf("assets/" + rpc::Sha256Hex(content) + suffix);
    std::ofstream(path, std::ios::binary) << content;
    if (is_old) std::filesystem::last_write_time(path, old);
  };
  for (const char* content : {"unused", "used", "referenced"}) put(content, "", true);
  put("new", "", false);
  put("unused", ".damaged", true);
  std::ofstream(folder_.PathOf("assets/of somebody else")) << "x";
  std::filesystem::last_write_time(folder_.PathOf("assets/of somebody else"), old);
  EXPECT_TRUE(store_.Has(rpc::Sha256Hex("used")));
  const auto unknown = [] { return absl::StatusOr<std::set<std::string>>(absl::UnavailableError("ledger")); };
  EXPECT_EQ(store_.RemoveUnused(unknown).message(), "ledger");
  EXPECT_TRUE(std::filesystem::exists(folder_.PathOf("assets/" + rpc::Sha256Hex("unused"))));
  const auto referenced = [] {
    return absl::StatusOr<std::set<std::string>>({rpc::Sha256Hex("referenced")});
  };
  EXPECT_TRUE(store_.RemoveUnused(referenced).ok());
  EXPECT_FALSE(store_.Has(rpc::Sha256Hex("unused")));
  for (const char* content : {"used", "referenced", "new"}) EXPECT_TRUE(store_.Has(rpc::Sha256Hex(content)));
  EXPECT_TRUE(std::filesystem::exists(folder_.PathOf("assets/of somebody else")));
  EXPECT_FALSE(std::filesystem::exists(folder_.PathOf("assets/" + rpc::Sha256Hex("unused") + ".damaged")));
}

TEST_F(AssetStoreTest, PatienceIsADayWithUploadsAndAWeekWithAssetsThatNoJobUses) {
  const auto now = std::filesystem::file_time_type::clock::now();
  const auto put = [&](const std::string& path, const std::string& content, std::chrono::minutes age) {
    std::ofstream(folder_.PathOf(path), std::ios::binary) << content;
    std::filesystem::last_write_time(folder_.PathOf(path), now - age);
  };
  const auto is_there = [&](const std::string& path) {
    return std::filesystem::exists(folder_.PathOf(path));
  };
  const std::string waits = "assets/" + rpc::Sha256Hex("waits");
  const std::string forgotten = "assets/" + rpc::Sha256Hex("forgotten");
  constexpr std::chrono::hours kWeek(7 * 24);
  constexpr std::chrono::hours kDay(24);
  constexpr std::chrono::minutes kSlack(10);
  put(waits, "waits", kWeek - kSlack);
  put(waits + ".damaged", "", kWeek - kSlack);
  put(forgotten, "forgotten", kWeek + kSlack);
  put(forgotten + ".damaged", "", kWeek + kSlack);
  EXPECT_TRUE(
      store_.RemoveUnused([] { return absl::StatusOr<std::set<std::string>>(std::set<std::string>()); })
          .ok());
  for (const char* suffix : {"", ".damaged"}) {
    EXPECT_TRUE(is_there(waits + suffix)) << suffix;
    EXPECT_FALSE(is_there(forgotten + suffix)) << suffix;
  }
  const std::string broken = "incoming/" + rpc::Sha256Hex("broken") + ".kept";
  const std::string old = "incoming/" + rpc::Sha256Hex("old") + ".kept";
  put(broken, "b", kDay - kSlack);
  put(old, "o", kDay + kSlack);
  store_.RemoveOldUploads();
  EXPECT_TRUE(is_there(broken));
  EXPECT_FALSE(is_there(old));
  // Of uploads of other coordinators, those that were written in the last minutes run.
  const std::string running = "incoming/" + rpc::Sha256Hex("runs");
  const std::string ended = "incoming/" + rpc::Sha256Hex("ended");
  put(running + ".other0", "r", std::chrono::minutes(9));
  put(ended + ".other1", "e", std::chrono::minutes(11));
  AssetStore second(folder_.PathOf("assets"), folder_.PathOf("incoming"), nullptr, PrivateFileSystem(),
                    {.uploader = "second"});
  EXPECT_TRUE(is_there(running + ".other0"));
  EXPECT_TRUE(is_there(ended + ".kept"));
}

TEST_F(AssetStoreTest, AUseIsRecordedOnceAnHour) {
  const std::string path = folder_.PathOf("assets/" + rpc::Sha256Hex("oak"));
  std::ofstream(path, std::ios::binary) << "oak";
  const auto now = std::filesystem::file_time_type::clock::now();
  for (const auto& [age, is_recorded] :
       {std::pair{std::chrono::minutes(55), false}, {std::chrono::minutes(65), true}}) {
    std::filesystem::last_write_time(path, now - age);
    EXPECT_TRUE(store_.Has(rpc::Sha256Hex("oak")));
    EXPECT_EQ(std::filesystem::last_write_time(path) > now - std::chrono::minutes(5), is_recorded);
  }
}

TEST_F(AssetStoreTest, NoNameLeadsOutOfTheFolder) {
  v1::AssetRef asset = Announce("oak");
  asset.set_sha256("../lock");
  EXPECT_EQ(store_.Receive(asset, "ann").status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_FALSE(store_.Has("../assets"));
  EXPECT_EQ(store_.Open("../assets", 0).status().code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(store_.Open(std::string(64, 'a'), 0).status().code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace lumifold::server
