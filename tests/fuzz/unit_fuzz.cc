// Units: chunks of a worker's stream as bytes of protobuf, and records of unit logs. A record's checksums are
// made right, so that what lies behind them is reached.

#include <cstring>
#include <fstream>

#include "absl/strings/str_cat.h"
#include "google/protobuf/stubs/logging.h"
#include "proto/rpc/checksum.h"
#include "proto/rpc/plane_compression.h"
#include "server/film/film_builder.h"
#include "server/film/unit_assembler.h"
#include "server/film/unit_log.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/encoded_unit.h"
#include "tests/support/random_unit.h"
#include "tests/support/temp_folder.h"

namespace lumifold::fuzz {
namespace {

const Rect kRect = {8, 0, 16, 8};
constexpr SampleRange kSamples = {0, 4};

/// Has planes of all encodings.
EdgedImage MadeUpUnit(v1::UnitKind kind, int32_t tile) {
  EdgedImage unit = RandomUnit({.frame = 0, .tile = tile, .pass = 0, .kind = kind}, kRect, kSamples, 1);
  std::vector<LayeredImage::Channel>& channels = unit.pixels.channels();
  channels[1].plane.Fill(0);
  for (int x = 0; x < kRect.width(); ++x) {
    for (int y = 0; y < kRect.height(); ++y) {
      channels[2].plane.At(x, y) = static_cast<float>(x * y) / 16;
      channels[3].plane.At(x, y) = static_cast<float>(x + y) / 3;
    }
  }
  return unit;
}

/// The messages in which a worker sends a unit.
std::vector<std::string> ChunksOf(v1::UnitKind kind, int32_t tile) {
  const EdgedImage unit = MadeUpUnit(kind, tile);
  std::vector<std::string> messages;
  const auto send = [&](const LayeredImage& picture, bool is_list) {
    if (picture.channels().empty()) return;
    rpc::PixelChunker chunker(picture);
    v1::PixelChunk chunk;
    while (chunker.Next(&chunk)) {
      v1::UnitChunk message;
      message.mutable_unit()->set_job_id("j-1");
      message.mutable_unit()->set_kind(kind);
      message.mutable_stats()->set_samples(64);
      *(is_list ? message.mutable_edges() : message.mutable_pixels()) = chunk;
      messages.push_back(message.SerializeAsString());
    }
  };
  send(ListOf(unit), true);
  send(unit.pixels, false);
  return messages;
}

std::string RecordOf(v1::UnitKind kind, int32_t tile) {
  const film::StoredUnit unit{{job::JobId("j-1"), {.frame = 0, .tile = tile, .pass = 0, .kind = kind}},
                              job::Attempt(1),
                              {},
                              MadeUpUnit(kind, tile)};
  const film::EncodedUnit encoded = Encoded(unit);
  std::string record = encoded.head;
  for (const rpc::PixelPiece& piece : encoded.payload) record += piece.bytes;
  return record;
}

/// Gives the first record of a log the checksums of what it holds, if it holds a record at all.
void RepairChecksums(std::string* log) {
  film::RecordPreamble preamble;
  if (log->size() < sizeof(preamble)) return;
  std::memcpy(&preamble, log->data(), sizeof(preamble));
  const std::string_view rest = std::string_view(*log).substr(sizeof(preamble));
  if (preamble.header_bytes > rest.size() || preamble.payload_bytes > rest.size() - preamble.header_bytes)
    return;
  preamble.payload_checksum = rpc::Checksum(rest.substr(preamble.header_bytes, preamble.payload_bytes));
  preamble.header_checksum = film::HeaderChecksum(preamble, rest.substr(0, preamble.header_bytes));
  std::memcpy(log->data(), &preamble, sizeof(preamble));
}

void ReadLog(std::string log) {
  static const TempFolder folder(InMemory());
  const std::string path = folder.PathOf("log");
  std::ofstream(path, std::ios::binary) << log;
  const absl::StatusOr<film::UnitLogReader> reader = film::UnitLogReader::Open(path);
  if (!reader.ok()) Fail("cannot open", std::string(reader.status().message()));
  uint64_t units = 0;
  const absl::StatusOr<uint64_t> end =
      reader->Scan(0, [&](const film::StoredUnit&, const film::RecordPlace& place) {
        ++units;
        if (place.offset + place.length > log.size())
          Fail("a record beyond the end", std::to_string(place.offset));
      });
  if (end.ok() && *end > log.size()) Fail("an end beyond the end", std::to_string(*end));
  const film::RecordPlace whole = {.offset = 0, .length = log.size()};
  (void)reader->Read(whole);
  (void)reader->ReadHeader(whole);
  (void)reader->ReadDigest(whole);
}

/// Bytes that are said to be a compressed plane.
void Decompress(std::string_view bytes) {
  static Plane plane(kRect.width(), kRect.height());
  if (!rpc::DecompressPlane(bytes, plane.view()).ok()) return;
  std::string again;
  if (rpc::PlaneCompressor().Append(plane.view(), &again) == 0) return;
  Plane same(kRect.width(), kRect.height());
  if (!rpc::DecompressPlane(again, same.view()).ok()) Fail("a plane that cannot be sent again", "");
  for (int y = 0; y < plane.height(); ++y) {
    if (std::memcmp(plane.Row(y), same.Row(y), static_cast<size_t>(plane.width()) * sizeof(float)) != 0)
      Fail("a plane that changes when it is sent again", "");
  }
}

/// A picture that was accepted.
LayeredImage ImageOf(const rpc::ReceivedPicture& picture) {
  if (picture.pieces.empty()) return {};
  absl::StatusOr<LayeredImage> image = rpc::ImageFromBytes(picture.layout, BytesOf(picture), {});
  if (!image.ok()) Fail("a unit without an image", std::string(image.status().message()));
  const rpc::ReceivedPicture again = Received(*image);
  if (rpc::BytesFromImage(*rpc::ImageFromBytes(again.layout, BytesOf(again), {})) !=
      rpc::BytesFromImage(*image))
    Fail("a unit that changes when it is sent again", "");
  if (BytesOf(again).size() > rpc::BytesFromImage(*image).size())
    Fail("a unit that is larger than its values", "");
  return *std::move(image);
}

/// Assembles the film of a unit that was accepted.
void MakeFilm(v1::UnitKind kind, const EdgedImage& unit) {
  film::FilmBuilder film(kRect, {});
  if (kind == v1::UNIT_KIND_PASS) {
    film::TileSums sums;
    sums.Add(unit);
    film.SetMeans(kRect, sums);
  } else {
    film.SetGeometry(kRect, unit.pixels);
    film.AddEdges(unit.edges);
  }
  const EdgedImage made = film.Take();
  if (made.fragments.height() != unit.fragments.height() || made.edges.height() != unit.edges.height())
    Fail("a film without some rows of its unit", "");
}

/// As the coordinator takes the messages of a stream.
void Assemble(v1::UnitKind kind, const std::vector<std::string>& messages) {
  film::UnitAssembler assembler(kind, kRect, kSamples);
  for (const std::string& bytes : messages) {
    v1::UnitChunk chunk;
    if (!chunk.ParseFromString(bytes)) return;
    // Most changes are in the pixels: with a right checksum, their values are looked at.
    for (v1::PixelChunk* pixels : {chunk.mutable_pixels(), chunk.mutable_edges()}) {
      if (pixels->checksum() != 0) pixels->set_checksum(rpc::Checksum(pixels->data()));
    }
    if (!chunk.has_pixels()) chunk.clear_pixels();
    if (chunk.edges().data().empty() && chunk.edges().checksum() == 0) chunk.clear_edges();
    if (!assembler.Add(std::move(chunk)).ok()) return;
    if (assembler.IsComplete()) break;
  }
  if (!assembler.IsComplete()) return;
  const film::DeliveredPixels delivered = assembler.Take();
  EdgedImage unit{ImageOf(delivered.pixels)};
  (kind == v1::UNIT_KIND_PASS ? unit.fragments : unit.edges) = ImageOf(delivered.edges);
  MakeFilm(kind, unit);
}

}  // namespace

std::vector<std::string> Seeds() {
  google::protobuf::SetLogHandler(nullptr);  // it would print a line for each malformed message
  std::vector<std::string> seeds;
  for (const int32_t tile : {0, 1}) {
    seeds.push_back("p" + Joined(ChunksOf(v1::UNIT_KIND_PASS, tile)));
    seeds.push_back("g" + Joined(ChunksOf(v1::UNIT_KIND_GEOMETRY, tile)));
    const std::string record = RecordOf(tile == 0 ? v1::UNIT_KIND_PASS : v1::UNIT_KIND_GEOMETRY, tile);
    seeds.push_back("l" + record);
    seeds.push_back(absl::StrCat("l", record, record));
    seeds.push_back("r" + record);
    std::string plane;
    rpc::PlaneCompressor().Append(MadeUpUnit(v1::UNIT_KIND_PASS, tile).pixels.channels()[3].plane.view(),
                                  &plane);
    seeds.push_back("z" + plane);
  }
  return seeds;
}

}  // namespace lumifold::fuzz

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  namespace fuzz = lumifold::fuzz;
  namespace v1 = lumifold::v1;
  if (size == 0) return 0;
  const std::string_view rest(reinterpret_cast<const char*>(data) + 1, size - 1);
  switch (data[0]) {
    case 'p':
      fuzz::Assemble(v1::UNIT_KIND_PASS, fuzz::Pieces(rest));
      return 0;
    case 'g':
      fuzz::Assemble(v1::UNIT_KIND_GEOMETRY, fuzz::Pieces(rest));
      return 0;
    case 'r': {
      std::string log(rest);
      fuzz::RepairChecksums(&log);
      fuzz::ReadLog(std::move(log));
      return 0;
    }
    case 'z':
      fuzz::Decompress(rest);
      return 0;
    default:
      fuzz::ReadLog(std::string(rest));
      return 0;
  }
}
