#include "tests/bench/farm_load_units.h"

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>
#include <google/protobuf/wire_format_lite.h>

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/image/layers.h"
#include "proto/rpc/checksum.h"
#include "proto/rpc/image_codec.h"
#include "proto/rpc/limits.h"
#include "tests/scenes/glb_writer.h"
#include "tests/scenes/scenes.h"
#include "tests/support/random_unit.h"
#include "worker/scene/gltf_loader.h"

namespace lumifold::bench {
namespace {

using google::protobuf::internal::WireFormatLite;
using google::protobuf::io::CodedOutputStream;

/// One pixel in this many is an edge pixel: a contour that crosses a tile of 32x32 twice.
constexpr int kPixelsPerEdge = 16;

/// Tiles of a scene that are rendered.
constexpr int32_t kVariants = 32;

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

/// The chunks of a picture with all planes as float32.
std::vector<std::string> Float32ChunksOf(const LayeredImage& picture) {
  std::vector<std::string> chunks;
  std::string bytes = rpc::BytesFromImage(picture);
  for (bool last = false; !last;) {
    last = bytes.size() <= rpc::kMaxChunkBytes;
    v1::PixelChunk chunk;
    chunk.set_index(static_cast<uint32_t>(chunks.size()));
    if (chunks.empty()) *chunk.mutable_layout() = rpc::LayoutOf(picture);
    chunk.set_data(bytes.substr(0, rpc::kMaxChunkBytes));
    chunk.set_checksum(rpc::Checksum(chunk.data()));
    chunk.set_last(last);
    bytes.erase(0, rpc::kMaxChunkBytes);
    chunks.push_back(chunk.SerializeAsString());
  }
  return chunks;
}

/// An edge set in which every sixteenth pixel of a tile of this size is an edge pixel.
LayeredImage MakeEdges(int width, int height) {
  LayeredImage edges(kSubSamples, std::max(1, width * height / kPixelsPerEdge));
  for (const std::string& name : layers::EdgeChannels()) {
    const FloatView view = edges.Add(name);
    for (int row = 0; row < edges.height(); ++row) {
      const int x = row * kPixelsPerEdge % width;
      const int y = row * kPixelsPerEdge / width;
      for (int i = 0; i < kSubSamples; ++i) {
        view.At(i, row) = name == layers::kPixelX   ? static_cast<float>(x)
                          : name == layers::kPixelY ? static_cast<float>(y)
                                                    : 0.01f * static_cast<float>(i + row);
      }
    }
  }
  return edges;
}

v1::UnitStats StatsOf(const Rect& rect, SampleRange samples, int64_t bad_samples) {
  v1::UnitStats stats;
  stats.set_bad_samples(bad_samples);
  stats.set_samples(int64_t{rect.width()} * rect.height() * samples.count());
  stats.set_seconds(0.25);
  return stats;
}

}  // namespace

absl::StatusOr<std::unique_ptr<ReadyUnits>> ReadyUnits::OfScene(const std::string& scene,
                                                                const LoadOfAJob& job) {
  const scenes::SceneEntry* entry = scenes::FindScene(scene);
  if (entry == nullptr) return absl::NotFoundError(absl::StrCat("no generated scene is called ", scene));
  const absl::StatusOr<std::string> glb = scenes::EncodeGlb(entry->build());
  if (!glb.ok()) return glb.status();
  absl::StatusOr<scene::Scene> loaded = scene::LoadGltf(*glb, scene, nullptr);
  if (!loaded.ok()) return loaded.status();
  render::RenderSettings settings;
  settings.width = job.size;
  settings.height = job.size;
  absl::StatusOr<std::unique_ptr<render::Renderer>> renderer =
      render::Renderer::Create(std::make_shared<scene::Scene>(*std::move(loaded)), settings);
  if (!renderer.ok()) return renderer.status();
  auto units = std::make_unique<ReadyUnits>(job.float32);
  units->renderer_ = *std::move(renderer);
  units->frame_size_ = job.size;
  const Rect rect = {0, 0, std::min(job.tile, job.size), std::min(job.tile, job.size)};
  for (int32_t variant = 0; variant < kVariants; ++variant) {
    units->UnitOf(v1::UNIT_KIND_PASS, variant, rect, {0, job.pass_samples});
    units->UnitOf(v1::UNIT_KIND_GEOMETRY, variant, rect, {});
  }
  return units;
}

Rect ReadyUnits::TileOf(int32_t variant, const Rect& rect) const {
  const int columns = frame_size_ / rect.width();
  const int number = static_cast<int>(int64_t{variant} * columns * (frame_size_ / rect.height()) / kVariants);
  const int x0 = number % columns * rect.width();
  const int y0 = number / columns * rect.height();
  return {x0, y0, x0 + rect.width(), y0 + rect.height()};
}

ReadyUnits::Chunks ReadyUnits::ChunksOf(const LayeredImage& picture) const {
  if (float32_) return Float32ChunksOf(picture);
  Chunks chunks;
  rpc::PixelChunker chunker(picture);
  v1::PixelChunk chunk;
  while (chunker.Next(&chunk)) chunks.push_back(chunk.SerializeAsString());
  return chunks;
}

ReadyUnits::Unit ReadyUnits::Make(v1::UnitKind kind, int32_t variant, const Rect& rect,
                                  SampleRange samples) const {
  Unit unit;
  if (renderer_ == nullptr) {
    unit.pixels = ChunksOf(RandomUnit({.kind = kind}, rect, samples, 1).pixels);
    if (kind == v1::UNIT_KIND_GEOMETRY) unit.list = MakeEdges(rect.width(), rect.height());
    return unit;
  }
  const Rect tile = TileOf(variant, rect);
  if (kind == v1::UNIT_KIND_GEOMETRY) {
    EdgedImage geometry = renderer_->RenderGeometry(tile, 0);
    unit.pixels = ChunksOf(geometry.pixels);
    unit.list = std::move(geometry.edges);
    MovePlaces(-tile.x0, -tile.y0, &unit.list);
    return unit;
  }
  render::RenderCounts counts;
  EdgedImage pass = renderer_->RenderPass(tile, 0, samples, &counts);
  unit.pixels = ChunksOf(pass.pixels);
  unit.list = std::move(pass.fragments);
  MovePlaces(-tile.x0, -tile.y0, &unit.list);
  unit.bad_samples = counts.bad_samples;
  return unit;
}

const ReadyUnits::Unit& ReadyUnits::UnitOf(v1::UnitKind kind, int32_t variant, const Rect& rect,
                                           SampleRange samples) {
  const uint32_t samples_b = samples.last / 2 - samples.first / 2;
  const Shape shape{kind, rect.width(), rect.height(), samples.count() - samples_b, samples_b, variant};
  absl::MutexLock lock(&mutex_);
  Unit& unit = units_[shape];
  if (unit.pixels.empty()) unit = Make(kind, variant, rect, samples);
  return unit;
}

std::vector<grpc::ByteBuffer> ReadyUnits::MessagesFor(const v1::Lease& lease) {
  const Rect rect = {lease.rect().x0(), lease.rect().y0(), lease.rect().x1(), lease.rect().y1()};
  const SampleRange samples = {static_cast<uint32_t>(lease.first_sample()),
                               static_cast<uint32_t>(lease.last_sample())};
  v1::UnitChunk names;
  *names.mutable_unit() = lease.unit();
  names.set_attempt(lease.attempt());
  const int32_t variant = renderer_ == nullptr ? 0 : lease.unit().tile() % kVariants;
  const Unit& unit = UnitOf(lease.unit().kind(), variant, rect, samples);
  std::vector<grpc::ByteBuffer> messages;
  if (unit.list.height() > 0) {
    LayeredImage list = unit.list.Crop(unit.list.bounds());
    MovePlaces(rect.x0, rect.y0, &list);
    for (const std::string& chunk : ChunksOf(list))
      messages.push_back(MakeMessage(names, v1::UnitChunk::kEdgesFieldNumber, grpc::Slice(chunk), nullptr));
  }
  const v1::UnitStats stats = StatsOf(rect, samples, unit.bad_samples);
  for (const std::string& chunk : unit.pixels) {
    const grpc::Slice shared(chunk.data(), chunk.size(), grpc::Slice::STATIC_SLICE);
    messages.push_back(MakeMessage(names, v1::UnitChunk::kPixelsFieldNumber, shared,
                                   &chunk == &unit.pixels.back() ? &stats : nullptr));
  }
  return messages;
}

}  // namespace lumifold::bench
