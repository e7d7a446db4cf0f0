#include "server/film/void_records.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

#include "tests/support/encoded_unit.h"
#include "tests/support/random_unit.h"
#include "tests/support/temp_folder.h"

namespace lumifold::film {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr Rect kVoidRect = {0, 0, 5, 3};

StoredUnit VoidUnit(int32_t tile) {
  const job::UnitKey key{1, tile, 0, v1::UNIT_KIND_PASS};
  return {{job::JobId("j-1"), key}, job::Attempt(7 + tile), {}, RandomUnit(key, kVoidRect, {0, 4}, 1)};
}

class VoidRecordsTest : public ::testing::Test {
 protected:
  std::vector<RecordPlace> Append(const std::vector<int32_t>& tiles, uint64_t after) {
    absl::StatusOr<UnitLog> log = UnitLog::Open(path_, after);
    EXPECT_TRUE(log.ok()) << log.status();
    std::vector<RecordPlace> places;
    for (const int32_t tile : tiles) places.push_back(*log->Append(Encoded(VoidUnit(tile))));
    EXPECT_TRUE(log->Sync().ok());
    return places;
  }

  std::vector<int32_t> Tiles(uint64_t* end = nullptr) const {
    std::vector<int32_t> tiles;
    const absl::StatusOr<uint64_t> scanned = UnitLogReader::Open(path_)->Scan(
        0, [&](const StoredUnit& unit, const RecordPlace&) { tiles.push_back(unit.unit.key.tile); });
    EXPECT_TRUE(scanned.ok()) << scanned.status();
    if (end != nullptr) *end = *scanned;
    return tiles;
  }

  TempFolder folder_;
  const std::string path_ = folder_.PathOf("frame.units");
};

TEST_F(VoidRecordsTest, AScanPassesOverThemAndFindsTheOthers) {
  const std::vector<RecordPlace> places = Append({0, 1, 2, 3}, 0);
  ASSERT_TRUE(VoidRecords(path_, {places[0], places[2]}).ok());
  EXPECT_THAT(Tiles(), ElementsAre(1, 3));
  EXPECT_EQ(UnitLogReader::Open(path_)->Read(places[2]).status().code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(UnitLogReader::Open(path_)->Read(places[3])->unit, VoidUnit(3).unit);
}

TEST_F(VoidRecordsTest, TheUnitIsAppendedAgainBehindTheOthers) {
  const std::vector<RecordPlace> places = Append({0, 1}, 0);
  ASSERT_TRUE(VoidRecords(path_, {places[0]}).ok());
  Append({0}, places[1].offset + places[1].length);
  EXPECT_THAT(Tiles(), ElementsAre(1, 0));
}

TEST_F(VoidRecordsTest, VoidRecordsAtTheEndAreCutOff) {
  const std::vector<RecordPlace> places = Append({0, 1}, 0);
  ASSERT_TRUE(VoidRecords(path_, {places[1]}).ok());
  uint64_t end = 0;
  EXPECT_THAT(Tiles(&end), ElementsAre(0));
  EXPECT_EQ(end, places[1].offset);
}

TEST_F(VoidRecordsTest, VoidingTwiceIsTheSame) {
  const std::vector<RecordPlace> places = Append({0}, 0);
  ASSERT_TRUE(VoidRecords(path_, places).ok());
  ASSERT_TRUE(VoidRecords(path_, places).ok());
  EXPECT_THAT(Tiles(), IsEmpty());
}

TEST_F(VoidRecordsTest, ALogThatIsGoneIsNotFound) {
  EXPECT_EQ(VoidRecords(path_, {{0, 100}}).code(), absl::StatusCode::kNotFound);
  EXPECT_TRUE(VoidRecords(path_, {}).ok());
}

}  // namespace
}  // namespace lumifold::film
