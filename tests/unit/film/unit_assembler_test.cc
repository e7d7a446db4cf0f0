#include "server/film/unit_assembler.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "proto/rpc/limits.h"
#include "tests/support/encoded_unit.h"
#include "tests/support/random_unit.h"

namespace lumifold::film {
namespace {

using ::testing::HasSubstr;

constexpr Rect kRect = {8, 0, 16, 4};
constexpr SampleRange kSamples = {0, 4};

EdgedImage Unit(v1::UnitKind kind) { return RandomUnit({0, 1, 0, kind}, kRect, kSamples, 1); }

/// The pieces of a unit as sent by a worker.
std::vector<v1::UnitChunk> PiecesOf(const EdgedImage& unit) {
  std::vector<v1::UnitChunk> pieces;
  v1::PixelChunk piece;
  if (unit.edges.height() > 0) {
    rpc::PixelChunker edges(unit.edges);
    while (edges.Next(&piece)) *pieces.emplace_back().mutable_edges() = piece;
  }
  rpc::PixelChunker pixels(unit.pixels);
  while (pixels.Next(&piece)) *pieces.emplace_back().mutable_pixels() = piece;
  return pieces;
}

std::string Bytes(const EdgedImage& unit) {
  return rpc::BytesFromImage(unit.pixels) + rpc::BytesFromImage(unit.edges);
}

TEST(UnitAssembler, GivesBackWhatWasSent) {
  for (const v1::UnitKind kind : {v1::UNIT_KIND_PASS, v1::UNIT_KIND_GEOMETRY}) {
    const EdgedImage unit = Unit(kind);
    UnitAssembler assembler(kind, kRect, kSamples);
    for (const v1::UnitChunk& piece : PiecesOf(unit)) {
      EXPECT_FALSE(assembler.IsComplete());
      ASSERT_TRUE(assembler.Add(piece).ok());
    }
    ASSERT_TRUE(assembler.IsComplete());
    const DeliveredPixels delivered = assembler.Take();
    EXPECT_FALSE(assembler.IsComplete());
    EXPECT_EQ(delivered.pixels.layout.SerializeAsString(), rpc::LayoutOf(unit.pixels).SerializeAsString());
    EXPECT_EQ(BytesOf(delivered.pixels) + BytesOf(delivered.edges), Bytes(unit));
  }
}

TEST(UnitAssembler, KeepsTheBytesOfAPieceThatIsMovedIn) {
  std::vector<v1::UnitChunk> pieces = PiecesOf(Unit(v1::UNIT_KIND_PASS));
  const char* const bytes = pieces[0].pixels().data().data();
  UnitAssembler assembler(v1::UNIT_KIND_PASS, kRect, kSamples);
  ASSERT_TRUE(assembler.Add(std::move(pieces[0])).ok());
  EXPECT_EQ(assembler.Take().pixels.pieces[0].bytes.data(), bytes);
}

/// Values of a large unit of width 257: a piece ends within some of its rows.
TEST(UnitAssembler, ChecksRowsThatAreCutByTheEndOfAPiece) {
  constexpr Rect kLarge = {0, 0, 257, 129};
  const int cut = static_cast<int>(rpc::kMaxChunkBytes / sizeof(float));
  const EdgedImage good = RandomUnit({0, 1, 0, v1::UNIT_KIND_PASS}, kLarge, kSamples, 1);
  for (const int at : {cut - 1, cut, static_cast<int>(good.pixels.channels().size()) * 257 * 129 - 1}) {
    EdgedImage unit = {good.pixels.Crop(good.pixels.bounds()), {}};
    LayeredImage::Channel& channel = unit.pixels.channels()[static_cast<size_t>(at / (257 * 129))];
    channel.plane.At(at % 257, at / 257 % 129) = NAN;
    UnitAssembler assembler(v1::UNIT_KIND_PASS, kLarge, kSamples);
    absl::Status status;
    for (const v1::UnitChunk& piece : PiecesOf(unit)) status = assembler.Add(piece);
    EXPECT_THAT(std::string(status.message()),
                HasSubstr(absl::StrCat(channel.name, " is nan at ", at % 257, ",", at / 257 % 129)));
  }
}

TEST(UnitAssembler, RefusesEdgesThatAreOutOfPlace) {
  const std::vector<v1::UnitChunk> pieces = PiecesOf(Unit(v1::UNIT_KIND_GEOMETRY));
  ASSERT_EQ(pieces.size(), 2u);
  UnitAssembler of_a_pass(v1::UNIT_KIND_PASS, kRect, kSamples);
  EXPECT_THAT(std::string(of_a_pass.Add(pieces[0]).message()), HasSubstr("only geometry units"));
  UnitAssembler twice(v1::UNIT_KIND_GEOMETRY, kRect, {});
  ASSERT_TRUE(twice.Add(pieces[0]).ok());
  EXPECT_THAT(std::string(twice.Add(pieces[0]).message()), HasSubstr("after the edge set"));
  UnitAssembler after_pixels(v1::UNIT_KIND_GEOMETRY, kRect, {});
  ASSERT_TRUE(after_pixels.Add(pieces[1]).ok());
  EXPECT_THAT(std::string(after_pixels.Add(pieces[0]).message()), HasSubstr("or the pixels"));
  EXPECT_THAT(std::string(after_pixels.Add(pieces[1]).message()), HasSubstr("after the last piece"));
  UnitAssembler both_at_once(v1::UNIT_KIND_GEOMETRY, kRect, {});
  v1::UnitChunk both = pieces[0];
  *both.mutable_pixels() = pieces[1].pixels();
  EXPECT_FALSE(both_at_once.Add(both).ok());
}

TEST(UnitAssembler, RefusesValuesThatAreNotValid) {
  EdgedImage unit = Unit(v1::UNIT_KIND_PASS);
  unit.pixels.Get(layers::kSamplesB).At(3, 2) = -2;
  UnitAssembler assembler(v1::UNIT_KIND_PASS, kRect, kSamples);
  EXPECT_THAT(std::string(assembler.Add(PiecesOf(unit)[0]).message()),
              HasSubstr("samples_b.Y is -2 at 11,2"));
}

TEST(UnitAssembler, RefusesAnEdgeSetOfAnotherTileOrOfTooManyRows) {
  UnitAssembler elsewhere(v1::UNIT_KIND_GEOMETRY, {0, 0, 8, 4}, {});
  EXPECT_THAT(std::string(elsewhere.Add(PiecesOf(Unit(v1::UNIT_KIND_GEOMETRY))[0]).message()),
              HasSubstr("edge set: the pixel"));
  UnitAssembler small(v1::UNIT_KIND_GEOMETRY, {8, 0, 9, 1}, {});  // two rows where there is one pixel
  EXPECT_THAT(std::string(small.Add(PiecesOf(Unit(v1::UNIT_KIND_GEOMETRY))[0]).message()),
              HasSubstr("size 16x2"));
}

}  // namespace
}  // namespace lumifold::film
