#include "server/film/unit_log.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <vector>

#include "absl/strings/str_cat.h"
#include "proto/rpc/checksum.h"
#include "proto/rpc/plane_codec.h"
#include "tests/support/encoded_unit.h"
#include "tests/support/random_unit.h"
#include "tests/support/temp_folder.h"

namespace lumifold::film {
namespace {

using ::testing::HasSubstr;

constexpr Rect kLoggedRect = {0, 0, 5, 3};

StoredUnit Unit(int32_t tile) {
  const job::UnitKey key{1, tile, 0, tile == 2 ? v1::UNIT_KIND_GEOMETRY : v1::UNIT_KIND_PASS};
  StoredUnit unit{
      {job::JobId("j-1"), key}, job::Attempt(7 + tile), {}, RandomUnit(key, kLoggedRect, {0, 4}, 1)};
  unit.stats.set_samples(60);
  unit.stats.add_warnings("no light");
  return unit;
}

/// The record of a unit as the format describes it, encoded from its planes.
std::string RecordOf(const StoredUnit& unit) {
  const auto put = [](uint64_t value, int bytes, std::string* out) {
    for (int i = 0; i < bytes; ++i) out->push_back(static_cast<char>(value >> 8 * i & 0xff));
  };
  v1::UnitChunk chunk;
  *chunk.mutable_unit() = ProtoFromUnit(unit.unit);
  chunk.set_attempt(unit.attempt.value());
  *chunk.mutable_pixels()->mutable_layout() = rpc::EncodePicture(unit.image.pixels).layout;
  *chunk.mutable_stats() = unit.stats;
  if (ListOf(unit.image).height() > 0)
    *chunk.mutable_edges()->mutable_layout() = rpc::EncodePicture(ListOf(unit.image)).layout;
  const std::string header = chunk.SerializeAsString();
  const std::string payload =
      rpc::EncodePicture(unit.image.pixels).bytes + rpc::EncodePicture(ListOf(unit.image)).bytes;
  std::string record = "LFU8";
  put(header.size(), 4, &record);
  put(payload.size(), 8, &record);
  put(rpc::Checksum(payload), 8, &record);
  put(rpc::Checksum(rpc::BytesFromImage(ListOf(unit.image)) + rpc::BytesFromImage(unit.image.pixels)), 8,
      &record);
  put(rpc::Checksum(record + header), 8, &record);
  return record + header + payload;
}

class UnitLogTest : public ::testing::Test {
 protected:
  std::vector<RecordPlace> WriteUnits(int count, uint64_t committed_bytes = 0) {
    absl::StatusOr<UnitLog> log = UnitLog::Open(path_, committed_bytes);
    EXPECT_TRUE(log.ok()) << log.status();
    std::vector<RecordPlace> places;
    for (int tile = 0; tile < count; ++tile) {
      const absl::StatusOr<RecordPlace> place = log->Append(Encoded(Unit(tile)));
      EXPECT_TRUE(place.ok()) << place.status();
      places.push_back(*place);
    }
    EXPECT_TRUE(log->Sync().ok());
    return places;
  }

  absl::StatusOr<StoredUnit> Read(const RecordPlace& place) {
    const absl::StatusOr<UnitLogReader> reader = UnitLogReader::Open(path_);
    if (!reader.ok()) return reader.status();
    return reader->Read(place);
  }

  uint64_t Scan(std::vector<int>* tiles) {
    const absl::StatusOr<UnitLogReader> reader = UnitLogReader::Open(path_);
    EXPECT_TRUE(reader.ok());
    const absl::StatusOr<uint64_t> good = reader->Scan(
        0, [&](const StoredUnit& unit, const RecordPlace&) { tiles->push_back(unit.unit.key.tile); });
    EXPECT_TRUE(good.ok()) << good.status();
    return *good;
  }

  std::string File() const {
    std::ifstream file(path_, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }
  void SetFile(const std::string& bytes) const {
    std::ofstream(path_, std::ios::binary).write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  }

  TempFolder folder_;
  const std::string path_ = folder_.PathOf("frame.units");
};

TEST_F(UnitLogTest, GivesBackWhatWasWritten) {
  const std::vector<RecordPlace> places = WriteUnits(3);
  for (const int tile : {2, 0, 1}) {
    const absl::StatusOr<StoredUnit> unit = Read(places[static_cast<size_t>(tile)]);
    ASSERT_TRUE(unit.ok()) << unit.status();
    EXPECT_EQ(unit->unit, Unit(tile).unit);
    EXPECT_EQ(unit->attempt, Unit(tile).attempt);
    EXPECT_EQ(unit->stats.warnings(0), "no light");
    EXPECT_EQ(UnitBytes(unit->image), UnitBytes(Unit(tile).image));
    EXPECT_TRUE(CheckUnitLayout(unit->unit.key.kind, kLoggedRect, rpc::LayoutOf(unit->image.pixels)).ok());
    EXPECT_EQ(unit->image.edges.height(), tile == 2 ? 2 : 0);
    EXPECT_EQ(unit->image.fragments.height(), tile == 0 ? 4 : 0);
  }
}

TEST_F(UnitLogTest, HoldsTheBytesThatTheFormatDescribes) {
  const std::vector<RecordPlace> places = WriteUnits(3);
  std::string expected;
  for (int tile = 0; tile < 3; ++tile) {
    EXPECT_EQ(places[static_cast<size_t>(tile)].offset, expected.size());
    expected += RecordOf(Unit(tile));
  }
  EXPECT_EQ(File(), expected);
}

TEST_F(UnitLogTest, PiecesOfALargeUnitAreOnePayload) {
  constexpr Rect kLarge = {0, 0, 257, 129};  // rows are cut by the ends of pieces
  for (const v1::UnitKind kind : {v1::UNIT_KIND_PASS, v1::UNIT_KIND_GEOMETRY}) {
    const job::UnitKey key{1, 1, 0, kind};
    const StoredUnit unit{{job::JobId("j-1"), key}, job::Attempt(7), {}, RandomUnit(key, kLarge, {0, 4}, 1)};
    const EncodedUnit encoded = Encoded(unit);
    EXPECT_GT(encoded.payload.size(), 1u);
    std::filesystem::remove(path_);
    absl::StatusOr<UnitLog> log = UnitLog::Open(path_, 0);
    const absl::StatusOr<RecordPlace> place = log->Append(encoded);
    ASSERT_TRUE(place.ok()) << place.status();
    EXPECT_EQ(place->length, encoded.size_bytes());
    EXPECT_EQ(File(), RecordOf(unit));
    const absl::StatusOr<StoredUnit> read = Read(*place);
    ASSERT_TRUE(read.ok()) << read.status();
    EXPECT_EQ(UnitBytes(read->image), UnitBytes(unit.image));
  }
}

TEST_F(UnitLogTest, AHeaderIsReadWithoutThePixels) {
  const std::vector<RecordPlace> places = WriteUnits(3);
  std::string damaged = File();
  for (const RecordPlace& place : places) damaged[place.offset + place.length - 1] ^= 1;
  SetFile(damaged);
  const absl::StatusOr<UnitLogReader> reader = UnitLogReader::Open(path_);
  for (const int tile : {2, 0, 1}) {
    const RecordPlace& place = places[static_cast<size_t>(tile)];
    const absl::StatusOr<UnitHeader> header = reader->ReadHeader(place);
    ASSERT_TRUE(header.ok()) << header.status();
    EXPECT_EQ(header->unit, Unit(tile).unit);
    EXPECT_EQ(header->outline.pixels.SerializeAsString(),
              rpc::EncodePicture(Unit(tile).image.pixels).layout.SerializeAsString());
    EXPECT_EQ(header->outline.list_rows, ListOf(Unit(tile).image).height());
    EXPECT_EQ(reader->Read(place).status().code(), absl::StatusCode::kDataLoss);
  }
}

TEST_F(UnitLogTest, EveryFlippedBitOfAHeaderIsFound) {
  const RecordPlace place = WriteUnits(1).front();
  const std::string good = File();
  const EdgedImage image = Unit(0).image;
  const size_t payload_bytes =
      rpc::EncodePicture(image.pixels).bytes.size() + rpc::EncodePicture(image.fragments).bytes.size();
  for (size_t at = 0; at < good.size() - payload_bytes; ++at) {
    std::string bad = good;
    bad[at] ^= static_cast<char>(1 << at % 8);
    SetFile(bad);
    const absl::Status status = UnitLogReader::Open(path_)->ReadHeader(place).status();
    ASSERT_EQ(status.code(), absl::StatusCode::kDataLoss) << at;
    ASSERT_THAT(std::string(status.message()), HasSubstr("record at 0"));
  }
}

TEST_F(UnitLogTest, EveryFlippedBitIsFound) {
  const RecordPlace place = WriteUnits(1).front();
  const std::string good = File();
  for (size_t at = 0; at < good.size(); ++at) {
    std::string bad = good;
    bad[at] ^= static_cast<char>(1 << at % 8);  // "LFU8" becomes "LFU0", which is not a version
    SetFile(bad);
    const absl::Status status = Read(place).status();
    ASSERT_EQ(status.code(), absl::StatusCode::kDataLoss) << at;
    ASSERT_THAT(std::string(status.message()), HasSubstr("record at 0"));
    std::vector<int> tiles;
    ASSERT_EQ(Scan(&tiles), 0u) << at;
  }
}

TEST_F(UnitLogTest, ATornTailIsIgnoredAndOverwritten) {
  const std::vector<RecordPlace> places = WriteUnits(3);
  const std::string whole = File();
  for (const uint64_t cut : {places[2].offset + 1, places[2].offset + 39, places[2].offset + 40,
                             places[2].offset + 100, uint64_t{whole.size() - 1}}) {
    SetFile(whole.substr(0, cut));
    std::vector<int> tiles;
    const uint64_t good = Scan(&tiles);
    EXPECT_EQ(good, places[2].offset);
    EXPECT_THAT(tiles, ::testing::ElementsAre(0, 1));
    WriteUnits(1, good);
    tiles.clear();
    Scan(&tiles);
    EXPECT_THAT(tiles, ::testing::ElementsAre(0, 1, 0));
  }
}

TEST_F(UnitLogTest, AScanGoesOnBehindADamagedRecord) {
  const std::vector<RecordPlace> places = WriteUnits(4);
  const std::string whole = File();
  // In the magic, in a size, in the header, and in the payload of record 1.
  for (const uint64_t at : {0u, 5u, 40u, 3000u}) {
    std::string damaged = whole;
    damaged[places[1].offset + at] ^= 0x55;
    SetFile(damaged);
    std::vector<int> tiles;
    EXPECT_EQ(Scan(&tiles), whole.size()) << at;
    EXPECT_THAT(tiles, ::testing::ElementsAre(0, 2, 3)) << at;
  }
}

TEST_F(UnitLogTest, AScanBeginsWhereItIsTold) {
  const std::vector<RecordPlace> places = WriteUnits(3);
  std::vector<int> tiles;
  const absl::StatusOr<uint64_t> end = UnitLogReader::Open(path_)->Scan(
      places[1].offset,
      [&](const StoredUnit& unit, const RecordPlace&) { tiles.push_back(unit.unit.key.tile); });
  EXPECT_EQ(*end, File().size());
  EXPECT_THAT(tiles, ::testing::ElementsAre(1, 2));
}

TEST_F(UnitLogTest, WhatTheLedgerDoesNotKnowIsCutOff) {
  const std::vector<RecordPlace> places = WriteUnits(3);
  ASSERT_TRUE(UnitLog::Open(path_, places[1].offset).ok());
  EXPECT_EQ(std::filesystem::file_size(path_), places[1].offset);
}

TEST_F(UnitLogTest, AFileShorterThanTheLedgerSaysIsNamed) {
  WriteUnits(1);
  const absl::Status status = UnitLog::Open(path_, 1 << 20).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(std::string(status.message()), HasSubstr(path_));
}

TEST_F(UnitLogTest, ALogOfAnotherVersionIsRefusedByName) {
  const RecordPlace place = WriteUnits(1).front();
  std::string old = File();
  old[3] = '2';
  SetFile(old);
  const absl::Status read = Read(place).status();
  EXPECT_EQ(read.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(read.message()), HasSubstr("another version of Lumifold"));
  EXPECT_THAT(std::string(read.message()), HasSubstr(path_));
  const absl::StatusOr<uint64_t> scan =
      UnitLogReader::Open(path_)->Scan(0, [](const StoredUnit&, const RecordPlace&) {});
  EXPECT_EQ(scan.status().code(), absl::StatusCode::kFailedPrecondition);
}

TEST_F(UnitLogTest, ADigestIsThatOfChannelsAndPixels) {
  StoredUnit unit = Unit(0);
  for (LayeredImage::Channel& channel : unit.image.pixels.channels()) channel.plane.Fill(0.5f);
  const std::string digest = Encoded(unit).digest;
  unit.attempt = job::Attempt(99);
  unit.stats.set_seconds(3);
  EXPECT_EQ(Encoded(unit).digest, digest);
  unit.image.pixels.channels()[3].plane.Fill(0.25f);
  EXPECT_NE(Encoded(unit).digest, digest);
  unit.image.pixels.channels()[3].plane.Fill(0.5f);
  EXPECT_EQ(Encoded(unit).digest, digest);
  std::swap(unit.image.pixels.channels()[0].name, unit.image.pixels.channels()[1].name);
  EXPECT_NE(Encoded(unit).digest, digest);
  std::swap(unit.image.pixels.channels()[0].name, unit.image.pixels.channels()[1].name);
  EncodedUnit encoded = Encoded(unit);
  absl::StatusOr<UnitLog> log = UnitLog::Open(path_, 0);
  const absl::StatusOr<RecordPlace> place = log->Append(encoded);
  EXPECT_EQ(*UnitLogReader::Open(path_)->ReadDigest(*place), digest);
}

TEST_F(UnitLogTest, ACompressedPlaneOfARecordThatIsDamagedIsNamed) {
  StoredUnit unit = Unit(0);
  Plane& plane = unit.image.pixels.channels()[1].plane;
  plane.Fill(0.1f);
  plane.At(0, 0) = 0.2f;
  DeliveredPixels delivered = {Received(unit.image.pixels), {}};
  ASSERT_EQ(delivered.pixels.layout.encodings(1), v1::PLANE_ENCODING_ZSTD);
  std::string& bytes = delivered.pixels.pieces[0].bytes;
  ++bytes[rpc::PlanesOf(delivered.pixels.layout)[1].first_byte];
  delivered.pixels.pieces[0].checksum = rpc::Checksum(bytes);
  absl::StatusOr<UnitLog> log = UnitLog::Open(path_, 0);
  const absl::StatusOr<RecordPlace> place =
      log->Append(EncodeUnit(unit.unit, unit.attempt, unit.stats, std::move(delivered)));
  const absl::Status read = Read(*place).status();
  EXPECT_EQ(read.code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(std::string(read.message()),
              HasSubstr(absl::StrCat("record at 0: pixels: ", unit.image.pixels.channels()[1].name,
                                     " cannot be decompressed: not one zstd frame")));
}

TEST_F(UnitLogTest, ARecordThatClaimsMoreThanATileIsRefused) {
  StoredUnit unit = Unit(0);
  DeliveredPixels delivered = {Received(unit.image.pixels), {}};
  delivered.pixels.layout.set_width(16384);
  delivered.pixels.layout.set_height(16384);
  delivered.pixels.layout.clear_encodings();
  for (int i = 0; i < delivered.pixels.layout.channels_size(); ++i)
    delivered.pixels.layout.add_encodings(v1::PLANE_ENCODING_CONSTANT);
  const std::string bytes(static_cast<size_t>(delivered.pixels.layout.channels_size()) * sizeof(float), '\0');
  delivered.pixels.pieces = {{bytes, rpc::Checksum(bytes)}};
  absl::StatusOr<UnitLog> log = UnitLog::Open(path_, 0);
  const absl::StatusOr<RecordPlace> place =
      log->Append(EncodeUnit(unit.unit, unit.attempt, unit.stats, std::move(delivered)));
  ASSERT_TRUE(place.ok());
  EXPECT_EQ(Read(*place).status().code(), absl::StatusCode::kDataLoss);
}

TEST_F(UnitLogTest, PlacesThatAreNoneAreRefused) {
  const std::vector<RecordPlace> places = WriteUnits(2);
  for (const RecordPlace& place :
       {RecordPlace{1, places[0].length}, RecordPlace{0, 10}, RecordPlace{0, places[0].length + 1},
        RecordPlace{~uint64_t{0}, 100}, RecordPlace{places[1].offset, ~uint64_t{0}}}) {
    EXPECT_EQ(Read(place).status().code(), absl::StatusCode::kDataLoss)
        << place.offset << "+" << place.length;
  }
}

}  // namespace
}  // namespace lumifold::film
