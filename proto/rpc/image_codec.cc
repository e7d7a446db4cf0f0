#include "proto/rpc/image_codec.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/rpc/checksum.h"
#include "proto/rpc/limits.h"

namespace lumifold::rpc {
namespace {

static_assert(std::endian::native == std::endian::little, "planes are sent in the byte order of memory");
static_assert(kMaxChunkBytes % sizeof(float) == 0, "a value never straddles two chunks");

// Calls run(plane, y, x, n) for each run of n values within one row of the values [first, first + count).
template <typename Run>
void ForEachRun(int width, int height, uint64_t first, uint64_t count, Run run) {
  const uint64_t area = static_cast<uint64_t>(width) * static_cast<uint64_t>(height);
  while (count > 0) {
    const uint64_t in_plane = first % area;
    const int y = static_cast<int>(in_plane / static_cast<uint64_t>(width));
    const int x = static_cast<int>(in_plane % static_cast<uint64_t>(width));
    const uint64_t n = std::min(count, static_cast<uint64_t>(width - x));
    run(static_cast<size_t>(first / area), y, x, static_cast<size_t>(n));
    first += n;
    count -= n;
  }
}

void AppendBytes(const LayeredImage& image, uint64_t first_byte, uint64_t byte_count, std::string* out) {
  out->reserve(out->size() + byte_count);
  ForEachRun(image.width(), image.height(), first_byte / sizeof(float), byte_count / sizeof(float),
             [&](size_t plane, int y, int x, size_t n) {
               const float* values = image.channels()[plane].plane.Row(y) + x;
               out->append(reinterpret_cast<const char*>(values), n * sizeof(float));
             });
}

uint64_t BytesOf(const LayeredImage& image) {
  return static_cast<uint64_t>(image.width()) * static_cast<uint64_t>(image.height()) * sizeof(float) *
         image.channels().size();
}

bool IsPrintable(std::string_view name) {
  return std::all_of(name.begin(), name.end(), [](char c) { return c > ' ' && c <= '~'; });
}

absl::Status CheckNames(const v1::PixelLayout& layout, const PixelLimits& limits) {
  std::vector<std::string_view> names;
  names.reserve(static_cast<size_t>(layout.channels_size()));
  for (const std::string& name : layout.channels()) {
    if (name.empty() || name.size() > static_cast<size_t>(limits.max_name_length) || !IsPrintable(name)) {
      return absl::InvalidArgumentError(absl::StrCat("pixel layout: the name of channel ", names.size(),
                                                     " is not 1 to ", limits.max_name_length,
                                                     " printable characters"));
    }
    names.push_back(name);
  }
  std::sort(names.begin(), names.end());
  const auto twice = std::adjacent_find(names.begin(), names.end());
  if (twice == names.end()) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat("pixel layout: channel ", std::string(*twice), " appears twice"));
}

}  // namespace

v1::PixelLayout LayoutOf(const LayeredImage& image) {
  v1::PixelLayout layout;
  layout.set_width(image.width());
  layout.set_height(image.height());
  for (const LayeredImage::Channel& channel : image.channels()) layout.add_channels(channel.name);
  return layout;
}

absl::Status CheckLayout(const v1::PixelLayout& layout, const PixelLimits& limits) {
  if (layout.width() < 1 || layout.height() < 1 || layout.width() > limits.max_width ||
      layout.height() > limits.max_height) {
    return absl::InvalidArgumentError(absl::StrCat("pixel layout: size ", layout.width(), "x",
                                                   layout.height(), " is not within 1x1 to ",
                                                   limits.max_width, "x", limits.max_height));
  }
  if (layout.channels_size() < 1 || layout.channels_size() > limits.max_channels) {
    return absl::InvalidArgumentError(
        absl::StrCat("pixel layout: ", layout.channels_size(), " channels, not 1 to ", limits.max_channels));
  }
  if (BytesOf(layout) > limits.max_bytes) {
    return absl::InvalidArgumentError(absl::StrCat(
        "pixel layout: ", BytesOf(layout), " bytes are more than the ", limits.max_bytes, " allowed"));
  }
  return CheckNames(layout, limits);
}

uint64_t BytesOf(const v1::PixelLayout& layout) {
  return static_cast<uint64_t>(layout.width()) * static_cast<uint64_t>(layout.height()) * sizeof(float) *
         static_cast<uint64_t>(layout.channels_size());
}

std::string BytesFromImage(const LayeredImage& image) {
  std::string bytes;
  AppendBytes(image, 0, BytesOf(image), &bytes);
  return bytes;
}

absl::StatusOr<LayeredImage> ImageFromBytes(const v1::PixelLayout& layout, std::string_view bytes,
                                            const PixelLimits& limits) {
  if (absl::Status status = CheckLayout(layout, limits); !status.ok()) return status;
  if (bytes.size() != BytesOf(layout)) {
    return absl::InvalidArgumentError(
        absl::StrCat("pixels: ", bytes.size(), " bytes, the layout needs ", BytesOf(layout)));
  }
  LayeredImage image(layout.width(), layout.height());
  for (const std::string& name : layout.channels()) image.Add(name);
  const char* next = bytes.data();
  ForEachRun(layout.width(), layout.height(), 0, bytes.size() / sizeof(float),
             [&](size_t plane, int y, int x, size_t n) {
               std::memcpy(image.channels()[plane].plane.Row(y) + x, next, n * sizeof(float));
               next += n * sizeof(float);
             });
  return image;
}

PixelChunker::PixelChunker(const LayeredImage& image) : image_(image), total_bytes_(BytesOf(image)) {}

bool PixelChunker::Next(v1::PixelChunk* chunk) {
  if (done_) return false;
  chunk->Clear();
  chunk->set_index(index_);
  if (index_ == 0) *chunk->mutable_layout() = LayoutOf(image_);
  const uint64_t size = std::min<uint64_t>(kMaxChunkBytes, total_bytes_ - sent_bytes_);
  AppendBytes(image_, sent_bytes_, size, chunk->mutable_data());
  sent_bytes_ += size;
  done_ = sent_bytes_ == total_bytes_;
  chunk->set_checksum(Checksum(chunk->data()));
  chunk->set_last(done_);
  ++index_;
  return true;
}

uint64_t ChecksumOf(absl::Span<const PixelPiece> pieces) {
  if (pieces.size() == 1) return pieces.front().checksum;
  RunningChecksum sum;
  for (const PixelPiece& piece : pieces) sum.Add(piece.bytes);
  return sum.Value();
}

uint64_t PixelAssembler::HeldBytes() const {
  uint64_t bytes = 0;
  for (const PixelPiece& piece : pieces_) bytes += piece.bytes.capacity();
  return bytes;
}

absl::Status PixelAssembler::CheckChunk(const v1::PixelChunk& chunk) {
  if (complete_) return absl::InvalidArgumentError("pixel chunk: a chunk after the last one");
  if (chunk.index() != pieces_.size()) {
    return absl::InvalidArgumentError(
        absl::StrCat("pixel chunk: number ", chunk.index(), ", expected ", pieces_.size()));
  }
  if (chunk.has_layout() != pieces_.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat("pixel chunk ", chunk.index(), ": chunk 0, and no other, must have the layout"));
  }
  if (chunk.has_layout()) {
    if (absl::Status status = CheckLayout(chunk.layout(), limits_); !status.ok()) return status;
    layout_ = chunk.layout();
  }
  const uint64_t expected = std::min<uint64_t>(kMaxChunkBytes, BytesOf(*layout_) - received_bytes_);
  if (chunk.data().size() != expected) {
    return absl::InvalidArgumentError(absl::StrCat("pixel chunk ", chunk.index(), ": ", chunk.data().size(),
                                                   " bytes, expected ", expected));
  }
  if (chunk.last() != (received_bytes_ + expected == BytesOf(*layout_))) {
    return absl::InvalidArgumentError(
        absl::StrCat("pixel chunk ", chunk.index(), ": `last` is set on the wrong chunk"));
  }
  if (chunk.checksum() != Checksum(chunk.data())) {
    return absl::DataLossError(absl::StrCat("pixel chunk ", chunk.index(), ": the checksum does not match"));
  }
  return absl::OkStatus();
}

absl::Status PixelAssembler::Add(v1::PixelChunk chunk) {
  if (!failure_.ok()) return failure_;
  failure_ = CheckChunk(chunk);
  if (!failure_.ok()) return failure_;
  received_bytes_ += chunk.data().size();
  complete_ = chunk.last();
  pieces_.push_back({std::move(*chunk.mutable_data()), chunk.checksum()});
  return absl::OkStatus();
}

ReceivedPicture PixelAssembler::Take() {
  LUMIFOLD_CHECK(complete_);
  ReceivedPicture picture{*std::move(layout_), std::move(pieces_)};
  *this = PixelAssembler(limits_);
  return picture;
}

}  // namespace lumifold::rpc
