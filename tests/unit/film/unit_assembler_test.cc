#include "server/film/unit_assembler.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "proto/rpc/checksum.h"
#include "proto/rpc/limits.h"
#include "proto/rpc/plane_codec.h"
#include "proto/rpc/plane_compression.h"
#include "tests/support/encoded_unit.h"
#include "tests/support/random_unit.h"

namespace lumifold::film {
namespace {

using ::testing::HasSubstr;

constexpr Rect kSentRect = {8, 0, 16, 4};
constexpr SampleRange kSentSamples = {0, 4};

EdgedImage Unit(v1::UnitKind kind) { return RandomUnit({0, 1, 0, kind}, kSentRect, kSentSamples, 1); }

EdgedImage PassWithFragments() {
  return RandomUnit({0, 2, 0, v1::UNIT_KIND_PASS}, kSentRect, kSentSamples, 1);
}

void FillPlane(const FloatView& plane, float value) {
  for (int y = 0; y < plane.height(); ++y) std::fill_n(plane.Row(y), plane.width(), value);
}

/// The pieces of a unit as sent by a worker.
std::vector<v1::UnitChunk> PiecesOf(const EdgedImage& unit) {
  std::vector<v1::UnitChunk> pieces;
  v1::PixelChunk piece;
  if (ListOf(unit).height() > 0) {
    rpc::PixelChunker list(ListOf(unit));
    while (list.Next(&piece)) *pieces.emplace_back().mutable_edges() = piece;
  }
  rpc::PixelChunker pixels(unit.pixels);
  while (pixels.Next(&piece)) *pieces.emplace_back().mutable_pixels() = piece;
  return pieces;
}

/// The values of a picture that was received.
std::string Decoded(const rpc::ReceivedPicture& picture) {
  if (picture.pieces.empty()) return "";
  return rpc::BytesFromImage(*rpc::ImageFromBytes(picture.layout, BytesOf(picture), {}));
}

TEST(UnitAssembler, GivesBackWhatWasSent) {
  for (const auto& [kind, unit] : {std::pair(v1::UNIT_KIND_PASS, Unit(v1::UNIT_KIND_PASS)),
                                   {v1::UNIT_KIND_PASS, PassWithFragments()},
                                   {v1::UNIT_KIND_GEOMETRY, Unit(v1::UNIT_KIND_GEOMETRY)}}) {
    UnitAssembler assembler(kind, kSentRect, kSentSamples);
    for (const v1::UnitChunk& piece : PiecesOf(unit)) {
      EXPECT_FALSE(assembler.IsComplete());
      ASSERT_TRUE(assembler.Add(piece).ok());
    }
    ASSERT_TRUE(assembler.IsComplete());
    const DeliveredPixels delivered = assembler.Take();
    EXPECT_FALSE(assembler.IsComplete());
    EXPECT_EQ(delivered.pixels.layout.SerializeAsString(),
              rpc::EncodePicture(unit.pixels).layout.SerializeAsString());
    EXPECT_EQ(Decoded(delivered.pixels) + Decoded(delivered.edges), UnitBytes(unit));
  }
}

/// The picture with all planes that can have it in one encoding, and the others as float32.
rpc::EncodedPicture EncodedAs(v1::PlaneEncoding wanted, const LayeredImage& image) {
  rpc::EncodedPicture picture{rpc::LayoutOf(image), ""};
  for (const LayeredImage::Channel& channel : image.channels()) {
    const ConstFloatView plane = channel.plane.view();
    if (wanted == v1::PLANE_ENCODING_ZSTD) {
      const uint32_t size = rpc::PlaneCompressor().Append(plane, &picture.bytes);
      picture.layout.add_encodings(size > 0 ? wanted : v1::PLANE_ENCODING_FLOAT);
      if (size > 0) picture.layout.add_compressed_bytes(size);
      if (size > 0) continue;
    } else {
      const bool is_constant = rpc::EncodingOf(plane) == v1::PLANE_ENCODING_CONSTANT;
      picture.layout.add_encodings(is_constant ? wanted : v1::PLANE_ENCODING_FLOAT);
    }
    rpc::AppendPlane(plane, picture.layout.encodings(picture.layout.encodings_size() - 1), &picture.bytes);
  }
  return picture;
}

/// Sends planes in encodings that a worker does not choose.
TEST(UnitAssembler, TakesAnyEncodingOfAnyPlane) {
  EdgedImage unit = Unit(v1::UNIT_KIND_PASS);
  FillPlane(unit.pixels.Get("noisy_a.R"), 0.5f);
  const uint64_t checksum = rpc::Checksum(rpc::BytesFromImage(unit.pixels));
  for (const v1::PlaneEncoding encoding : {v1::PLANE_ENCODING_FLOAT, v1::PLANE_ENCODING_HALF,
                                           v1::PLANE_ENCODING_CONSTANT, v1::PLANE_ENCODING_ZSTD}) {
    v1::UnitChunk chunk;
    rpc::PixelChunker(EncodedAs(encoding, unit.pixels)).Next(chunk.mutable_pixels());
    ASSERT_THAT(chunk.pixels().layout().encodings(), ::testing::Contains(encoding));
    UnitAssembler assembler(v1::UNIT_KIND_PASS, kSentRect, kSentSamples);
    ASSERT_TRUE(assembler.Add(chunk).ok());
    const DeliveredPixels delivered = assembler.Take();
    EXPECT_EQ(Decoded(delivered.pixels), rpc::BytesFromImage(unit.pixels));
    EXPECT_EQ(delivered.values_checksum, checksum) << "the digest must not depend on the encoding";
  }
}

TEST(UnitAssembler, TheChecksumIsThatOfAllValues) {
  for (const bool of_pass : {false, true}) {
    const v1::UnitKind kind = of_pass ? v1::UNIT_KIND_PASS : v1::UNIT_KIND_GEOMETRY;
    const EdgedImage unit = of_pass ? PassWithFragments() : Unit(kind);
    UnitAssembler assembler(kind, kSentRect, of_pass ? kSentSamples : SampleRange{});
    for (const v1::UnitChunk& piece : PiecesOf(unit)) ASSERT_TRUE(assembler.Add(piece).ok());
    EXPECT_EQ(assembler.Take().values_checksum,
              rpc::Checksum(rpc::BytesFromImage(ListOf(unit)) + rpc::BytesFromImage(unit.pixels)));
  }
}

/// A plane whose bytes arrived as they were sent, but are no compressed plane.
TEST(UnitAssembler, RefusesAPlaneThatCannotBeDecompressed) {
  for (const bool of_edges : {false, true}) {
    const v1::UnitKind kind = of_edges ? v1::UNIT_KIND_GEOMETRY : v1::UNIT_KIND_PASS;
    const EdgedImage unit = Unit(kind);
    const LayeredImage& image = of_edges ? unit.edges : unit.pixels;
    rpc::EncodedPicture picture = EncodedAs(v1::PLANE_ENCODING_ZSTD, image);
    ASSERT_GT(picture.layout.compressed_bytes_size(), 0);
    const auto& encodings = picture.layout.encodings();
    const auto at =
        std::find(encodings.begin(), encodings.end(), v1::PLANE_ENCODING_ZSTD) - encodings.begin();
    const std::string& channel = image.channels()[static_cast<size_t>(at)].name;
    ++picture.bytes[rpc::PlanesOf(picture.layout)[static_cast<size_t>(at)].first_byte];
    v1::UnitChunk chunk;
    rpc::PixelChunker(std::move(picture)).Next(of_edges ? chunk.mutable_edges() : chunk.mutable_pixels());
    UnitAssembler assembler(kind, kSentRect, kSentSamples);
    EXPECT_EQ(assembler.Add(chunk).message(), absl::StrCat(of_edges ? "edge set: " : "unit: ", channel,
                                                           " cannot be decompressed: not one zstd frame"));
  }
}

TEST(UnitAssembler, ChecksThePlanesOfEachEncoding) {
  for (const char* channel : {"noisy_a.R", "samples_a.Y"}) {
    for (const bool constant : {false, true}) {
      EdgedImage unit = Unit(v1::UNIT_KIND_PASS);
      const FloatView plane = unit.pixels.Get(channel);
      FillPlane(plane, constant ? INFINITY : 1.0f);
      plane.At(0, 0) = INFINITY;
      UnitAssembler assembler(v1::UNIT_KIND_PASS, kSentRect, kSentSamples);
      EXPECT_THAT(std::string(assembler.Add(PiecesOf(unit)[0]).message()),
                  HasSubstr(absl::StrCat(channel, " is inf at 8,0")));
    }
  }
  EdgedImage unit = Unit(v1::UNIT_KIND_PASS);
  FillPlane(unit.pixels.Get("samples_a.Y"), 1.0f);  // of two samples each
  UnitAssembler too_few(v1::UNIT_KIND_PASS, kSentRect, kSentSamples);
  EXPECT_THAT(std::string(too_few.Add(PiecesOf(unit)[0]).message()), HasSubstr("has 96 samples"));
  FillPlane(unit.pixels.Get("samples_a.Y"), 2.0f);
  unit.pixels.Get("samples_a.Y").At(0, 0) = 1.0f;  // as halves
  UnitAssembler one_less(v1::UNIT_KIND_PASS, kSentRect, kSentSamples);
  EXPECT_THAT(std::string(one_less.Add(PiecesOf(unit)[0]).message()), HasSubstr("has 127 samples"));
}

TEST(UnitAssembler, KeepsTheBytesOfAPieceThatIsMovedIn) {
  std::vector<v1::UnitChunk> pieces = PiecesOf(Unit(v1::UNIT_KIND_PASS));
  const char* const bytes = pieces[0].pixels().data().data();
  UnitAssembler assembler(v1::UNIT_KIND_PASS, kSentRect, kSentSamples);
  ASSERT_TRUE(assembler.Add(std::move(pieces[0])).ok());
  EXPECT_EQ(assembler.Take().pixels.pieces[0].bytes.data(), bytes);
}

/// Values of a large unit of width 257: a piece ends within some of its rows.
TEST(UnitAssembler, ChecksRowsThatAreCutByTheEndOfAPiece) {
  constexpr Rect kLarge = {0, 0, 257, 129};
  const int cut = static_cast<int>(rpc::kMaxChunkBytes / sizeof(float));
  const EdgedImage good = RandomUnit({0, 1, 0, v1::UNIT_KIND_PASS}, kLarge, kSentSamples, 1);
  for (const int at : {cut - 1, cut, static_cast<int>(good.pixels.channels().size()) * 257 * 129 - 1}) {
    EdgedImage unit = {good.pixels.Crop(good.pixels.bounds()), {}};
    LayeredImage::Channel& channel = unit.pixels.channels()[static_cast<size_t>(at / (257 * 129))];
    channel.plane.At(at % 257, at / 257 % 129) = NAN;
    for (const v1::PlaneEncoding encoding : {v1::PLANE_ENCODING_FLOAT, v1::PLANE_ENCODING_ZSTD}) {
      UnitAssembler assembler(v1::UNIT_KIND_PASS, kLarge, kSentSamples);
      rpc::PixelChunker chunker(EncodedAs(encoding, unit.pixels));
      absl::Status status;
      for (v1::UnitChunk piece; chunker.Next(piece.mutable_pixels());) status = assembler.Add(piece);
      EXPECT_THAT(std::string(status.message()),
                  HasSubstr(absl::StrCat(channel.name, " is nan at ", at % 257, ",", at / 257 % 129)));
    }
  }
}

TEST(UnitAssembler, RefusesEdgesThatAreOutOfPlace) {
  const std::vector<v1::UnitChunk> pieces = PiecesOf(Unit(v1::UNIT_KIND_GEOMETRY));
  ASSERT_EQ(pieces.size(), 2u);
  UnitAssembler of_a_pass(v1::UNIT_KIND_PASS, kSentRect, kSentSamples);
  EXPECT_THAT(std::string(of_a_pass.Add(pieces[0]).message()), HasSubstr("size 16x2 is not within"));
  UnitAssembler twice(v1::UNIT_KIND_GEOMETRY, kSentRect, SampleRange{});
  ASSERT_TRUE(twice.Add(pieces[0]).ok());
  EXPECT_THAT(std::string(twice.Add(pieces[0]).message()), HasSubstr("after the list"));
  UnitAssembler after_pixels(v1::UNIT_KIND_GEOMETRY, kSentRect, SampleRange{});
  ASSERT_TRUE(after_pixels.Add(pieces[1]).ok());
  EXPECT_THAT(std::string(after_pixels.Add(pieces[0]).message()), HasSubstr("or the pixels"));
  EXPECT_THAT(std::string(after_pixels.Add(pieces[1]).message()), HasSubstr("after the last piece"));
  UnitAssembler both_at_once(v1::UNIT_KIND_GEOMETRY, kSentRect, SampleRange{});
  v1::UnitChunk both = pieces[0];
  *both.mutable_pixels() = pieces[1].pixels();
  EXPECT_FALSE(both_at_once.Add(both).ok());
}

TEST(UnitAssembler, RefusesMoreSamplesOnSurfacesThanInThePixel) {
  EdgedImage unit = PassWithFragments();
  const FloatView counts = unit.fragments.Get(layers::kSamplesA);
  counts.At(0, 0) += 1;
  UnitAssembler assembler(v1::UNIT_KIND_PASS, kSentRect, kSentSamples);
  const std::vector<v1::UnitChunk> pieces = PiecesOf(unit);
  ASSERT_TRUE(assembler.Add(pieces[0]).ok());
  EXPECT_EQ(assembler.Add(pieces[1]).message(),
            "fragments: those at 15,0 have 3 samples_a.Y, but the pixel has 2");
  counts.At(0, 0) -= 2;  // fewer: other samples may have left the scene
  UnitAssembler fewer(v1::UNIT_KIND_PASS, kSentRect, kSentSamples);
  for (const v1::UnitChunk& piece : PiecesOf(unit)) EXPECT_TRUE(fewer.Add(piece).ok());
}

TEST(UnitAssembler, RefusesFragmentsThatThePlanLeavesOut) {
  UnitAssembler assembler(v1::UNIT_KIND_PASS, kSentRect, kSentSamples, {.carried = {.indirect = false}});
  EXPECT_THAT(std::string(assembler.Add(PiecesOf(PassWithFragments())[0]).message()),
              HasSubstr("fragments: 1 columns of 37 channels, expected 1 of 31"));
  UnitAssembler none(v1::UNIT_KIND_PASS, kSentRect, kSentSamples,
                     {.carried = {.direct = false, .indirect = false, .glossy = false}});
  EXPECT_EQ(none.Add(PiecesOf(PassWithFragments())[0]).message(),
            "fragments: the plan of the job has no light of surfaces");
}

TEST(UnitAssembler, RefusesValuesThatAreNotValid) {
  EdgedImage unit = Unit(v1::UNIT_KIND_PASS);
  unit.pixels.Get(layers::kSamplesB).At(3, 2) = -2;
  UnitAssembler assembler(v1::UNIT_KIND_PASS, kSentRect, kSentSamples);
  EXPECT_THAT(std::string(assembler.Add(PiecesOf(unit)[0]).message()),
              HasSubstr("samples_b.Y is -2 at 11,2"));
}

TEST(UnitAssembler, RefusesAnEdgeSetOfAnotherTileOrOfTooManyRows) {
  UnitAssembler elsewhere(v1::UNIT_KIND_GEOMETRY, {0, 0, 8, 4}, SampleRange{});
  EXPECT_THAT(std::string(elsewhere.Add(PiecesOf(Unit(v1::UNIT_KIND_GEOMETRY))[0]).message()),
              HasSubstr("edge set: the pixel"));
  UnitAssembler small(v1::UNIT_KIND_GEOMETRY, {8, 0, 9, 1},
                      SampleRange{});  // two rows where there is one pixel
  EXPECT_THAT(std::string(small.Add(PiecesOf(Unit(v1::UNIT_KIND_GEOMETRY))[0]).message()),
              HasSubstr("size 16x2"));
}

}  // namespace
}  // namespace lumifold::film
