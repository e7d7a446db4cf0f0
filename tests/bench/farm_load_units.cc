#include "tests/bench/farm_load_units.h"

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>
#include <google/protobuf/wire_format_lite.h>

#include <algorithm>

#include "filter/image/layers.h"
#include "proto/rpc/image_codec.h"
#include "tests/support/random_unit.h"

namespace lumifold::bench {
namespace {

using google::protobuf::internal::WireFormatLite;
using google::protobuf::io::CodedOutputStream;

/// One pixel in this many is an edge pixel: a contour that crosses a tile of 32x32 twice.
constexpr int kPixelsPerEdge = 16;

/// Tag and length of a field whose content is `size` bytes long.
std::string FieldHead(int number, size_t size) {
  std::string head;
  google::protobuf::io::StringOutputStream stream(&head);
  CodedOutputStream out(&stream);
  out.WriteTag(WireFormatLite::MakeTag(number, WireFormatLite::WIRETYPE_LENGTH_DELIMITED));
  out.WriteVarint32(static_cast<uint32_t>(size));
  out.Trim();
  return head;
}

/// A WorkerMessage with a UnitChunk of these fields: those of `names` and `stats`, and between them the field
/// `number`, whose serialised content is `content`.
grpc::ByteBuffer MakeMessage(const v1::UnitChunk& names, int number, const grpc::Slice& content,
                             const v1::UnitStats* stats) {
  const std::string before = names.SerializeAsString() + FieldHead(number, content.size());
  std::string after;
  if (stats != nullptr) {
    const std::string bytes = stats->SerializeAsString();
    after = FieldHead(v1::UnitChunk::kStatsFieldNumber, bytes.size()) + bytes;
  }
  const size_t size = before.size() + content.size() + after.size();
  const std::string head = FieldHead(v1::WorkerMessage::kChunkFieldNumber, size) + before;
  const grpc::Slice slices[] = {grpc::Slice(head), content, grpc::Slice(after)};
  return {slices, 3};
}

std::vector<std::string> ChunksOf(const LayeredImage& picture) {
  std::vector<std::string> chunks;
  rpc::PixelChunker chunker(picture);
  v1::PixelChunk chunk;
  while (chunker.Next(&chunk)) chunks.push_back(chunk.SerializeAsString());
  return chunks;
}

/// An edge set in which every sixteenth pixel of a tile is an edge pixel.
LayeredImage MakeEdges(const Rect& rect) {
  const int pixels = rect.width() * rect.height();
  LayeredImage edges(kSubSamples, std::max(1, pixels / kPixelsPerEdge));
  for (const std::string& name : layers::EdgeChannels()) {
    const FloatView view = edges.Add(name);
    for (int row = 0; row < edges.height(); ++row) {
      const int pixel = row * kPixelsPerEdge;
      for (int i = 0; i < kSubSamples; ++i) {
        view.At(i, row) = name == layers::kPixelX   ? static_cast<float>(rect.x0 + pixel % rect.width())
                          : name == layers::kPixelY ? static_cast<float>(rect.y0 + pixel / rect.width())
                                                    : 0.01f * static_cast<float>(i + row);
      }
    }
  }
  return edges;
}

v1::UnitStats StatsOf(const Rect& rect, SampleRange samples) {
  v1::UnitStats stats;
  stats.set_samples(int64_t{rect.width()} * rect.height() * samples.count());
  stats.set_seconds(0.25);
  return stats;
}

}  // namespace

const ReadyUnits::Chunks& ReadyUnits::PixelsOf(v1::UnitKind kind, const Rect& rect, SampleRange samples) {
  const uint32_t samples_b = samples.last / 2 - samples.first / 2;
  const Shape shape{kind, rect.width(), rect.height(), samples.count() - samples_b, samples_b};
  absl::MutexLock lock(&mutex_);
  Chunks& chunks = pixels_[shape];
  if (chunks.empty()) chunks = ChunksOf(RandomUnit({.kind = kind}, rect, samples, 1).pixels);
  return chunks;
}

std::vector<grpc::ByteBuffer> ReadyUnits::MessagesFor(const v1::Lease& lease) {
  const Rect rect = {lease.rect().x0(), lease.rect().y0(), lease.rect().x1(), lease.rect().y1()};
  const SampleRange samples = {static_cast<uint32_t>(lease.first_sample()),
                               static_cast<uint32_t>(lease.last_sample())};
  v1::UnitChunk names;
  *names.mutable_unit() = lease.unit();
  names.set_attempt(lease.attempt());
  std::vector<grpc::ByteBuffer> messages;
  if (lease.unit().kind() == v1::UNIT_KIND_GEOMETRY) {
    for (const std::string& chunk : ChunksOf(MakeEdges(rect)))
      messages.push_back(MakeMessage(names, v1::UnitChunk::kEdgesFieldNumber, grpc::Slice(chunk), nullptr));
  }
  const v1::UnitStats stats = StatsOf(rect, samples);
  const Chunks& chunks = PixelsOf(lease.unit().kind(), rect, samples);
  for (const std::string& chunk : chunks) {
    const grpc::Slice shared(chunk.data(), chunk.size(), grpc::Slice::STATIC_SLICE);
    messages.push_back(MakeMessage(names, v1::UnitChunk::kPixelsFieldNumber, shared,
                                   &chunk == &chunks.back() ? &stats : nullptr));
  }
  return messages;
}

}  // namespace lumifold::bench
