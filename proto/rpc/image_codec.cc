#include "proto/rpc/image_codec.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/rpc/checksum.h"
#include "proto/rpc/limits.h"
#include "proto/rpc/plane_codec.h"

namespace lumifold::rpc {
namespace {

/// Bytes of the planes as float32.
uint64_t FloatBytesOf(const v1::PixelLayout& layout) {
  return static_cast<uint64_t>(layout.width()) * static_cast<uint64_t>(layout.height()) * sizeof(float) *
         static_cast<uint64_t>(layout.channels_size());
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

absl::Status CheckEncodings(const v1::PixelLayout& layout) {
  if (layout.encodings_size() != 0 && layout.encodings_size() != layout.channels_size()) {
    return absl::InvalidArgumentError(absl::StrCat("pixel layout: ", layout.encodings_size(),
                                                   " encodings of ", layout.channels_size(), " channels"));
  }
  const auto unknown =
      std::find_if_not(layout.encodings().begin(), layout.encodings().end(), v1::PlaneEncoding_IsValid);
  if (unknown == layout.encodings().end()) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat("pixel layout: unknown encoding ", *unknown));
}

}  // namespace

v1::PixelLayout LayoutOf(const LayeredImage& image) {
  v1::PixelLayout layout;
  layout.set_width(image.width());
  layout.set_height(image.height());
  for (const LayeredImage::Channel& channel : image.channels()) layout.add_channels(channel.name);
  return layout;
}

v1::PixelLayout EncodedLayoutOf(const LayeredImage& image) {
  v1::PixelLayout layout = LayoutOf(image);
  for (const LayeredImage::Channel& channel : image.channels())
    layout.add_encodings(EncodingOf(channel.plane.view()));
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
  if (FloatBytesOf(layout) > limits.max_bytes) {
    return absl::InvalidArgumentError(absl::StrCat(
        "pixel layout: ", FloatBytesOf(layout), " bytes are more than the ", limits.max_bytes, " allowed"));
  }
  if (absl::Status status = CheckEncodings(layout); !status.ok()) return status;
  return CheckNames(layout, limits);
}

uint64_t EncodedBytesOf(const v1::PixelLayout& layout) {
  if (layout.encodings_size() == 0) return FloatBytesOf(layout);
  const uint64_t area = static_cast<uint64_t>(layout.width()) * static_cast<uint64_t>(layout.height());
  uint64_t bytes = 0;
  for (const int encoding : layout.encodings())
    bytes += EncodedBytes(static_cast<v1::PlaneEncoding>(encoding), area);
  return bytes;
}

std::string BytesFromImage(const LayeredImage& image) {
  std::string bytes;
  bytes.reserve(FloatBytesOf(LayoutOf(image)));
  for (const LayeredImage::Channel& channel : image.channels())
    AppendPlane(channel.plane.view(), v1::PLANE_ENCODING_FLOAT, &bytes);
  return bytes;
}

absl::StatusOr<LayeredImage> ImageFromBytes(const v1::PixelLayout& layout, std::string_view bytes,
                                            const PixelLimits& limits) {
  if (absl::Status status = CheckLayout(layout, limits); !status.ok()) return status;
  if (bytes.size() != EncodedBytesOf(layout)) {
    return absl::InvalidArgumentError(
        absl::StrCat("pixels: ", bytes.size(), " bytes, the layout needs ", EncodedBytesOf(layout)));
  }
  const std::vector<EncodedPlane> planes = PlanesOf(layout);
  LayeredImage image(layout.width(), layout.height());
  for (size_t i = 0; i < planes.size(); ++i) {
    const FloatView view = image.Add(layout.channels(static_cast<int>(i)));
    const auto width = static_cast<size_t>(view.width());
    const uint64_t row_bytes = EncodedBytes(planes[i].encoding, width);
    for (int y = 0; y < view.height(); ++y) {
      const uint64_t first = planes[i].RowByte(y, view.width());
      DecodeValues(planes[i].encoding, bytes.substr(first, row_bytes), view.Row(y), width);
    }
  }
  return image;
}

PixelChunker::PixelChunker(const LayeredImage& image) : image_(image), layout_(EncodedLayoutOf(image)) {}

bool PixelChunker::Next(v1::PixelChunk* chunk) {
  if (done_) return false;
  chunk->Clear();
  chunk->set_index(index_);
  if (index_ == 0) *chunk->mutable_layout() = layout_;
  const std::vector<LayeredImage::Channel>& channels = image_.channels();
  // One byte more than the piece tells whether it is the last.
  for (; encoded_.size() <= kMaxChunkBytes && next_plane_ < channels.size(); ++next_plane_)
    AppendPlane(channels[next_plane_].plane.view(), layout_.encodings(static_cast<int>(next_plane_)),
                &encoded_);
  if (encoded_.size() > kMaxChunkBytes) {
    chunk->set_data(encoded_.data(), kMaxChunkBytes);
    encoded_.erase(0, kMaxChunkBytes);
  } else {
    *chunk->mutable_data() = std::move(encoded_);
    done_ = true;
  }
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
  const uint64_t missing = EncodedBytesOf(*layout_) - received_bytes_;
  const uint64_t expected = std::min<uint64_t>(kMaxChunkBytes, missing);
  if (chunk.data().size() != expected) {
    return absl::InvalidArgumentError(absl::StrCat("pixel chunk ", chunk.index(), ": ", chunk.data().size(),
                                                   " bytes, expected ", expected));
  }
  if (chunk.last() != (expected == missing)) {
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
