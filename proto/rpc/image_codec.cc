#include "proto/rpc/image_codec.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/rpc/checksum.h"
#include "proto/rpc/limits.h"
#include "proto/rpc/plane_codec.h"
#include "proto/rpc/plane_compression.h"

namespace lumifold::rpc {
namespace {

/// Pixels of a plane.
uint64_t AreaOf(const v1::PixelLayout& layout) {
  return static_cast<uint64_t>(layout.width()) * static_cast<uint64_t>(layout.height());
}

/// Bytes of the planes as float32.
uint64_t FloatBytesOf(const v1::PixelLayout& layout) {
  return AreaOf(layout) * sizeof(float) * static_cast<uint64_t>(layout.channels_size());
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

absl::Status CheckCompressedBytes(const v1::PixelLayout& layout) {
  const auto compressed =
      std::count(layout.encodings().begin(), layout.encodings().end(), v1::PLANE_ENCODING_ZSTD);
  if (layout.compressed_bytes_size() != compressed) {
    return absl::InvalidArgumentError(absl::StrCat("pixel layout: ", layout.compressed_bytes_size(),
                                                   " sizes of ", compressed, " compressed planes"));
  }
  const uint64_t most = AreaOf(layout) * sizeof(float) - 1;
  for (const uint32_t bytes : layout.compressed_bytes()) {
    if (bytes >= 1 && bytes <= most) continue;
    return absl::InvalidArgumentError(
        absl::StrCat("pixel layout: a compressed plane of ", bytes, " bytes, not 1 to ", most));
  }
  return absl::OkStatus();
}

/// "a.R cannot be decompressed: ...".
absl::Status CannotDecompress(const std::string& channel, const absl::Status& cause) {
  return absl::InvalidArgumentError(
      absl::StrCat("pixels: ", channel, " cannot be decompressed: ", std::string(cause.message())));
}

absl::Status DecodePlane(v1::PlaneEncoding encoding, std::string_view bytes, FloatView plane) {
  if (encoding == v1::PLANE_ENCODING_ZSTD) return DecompressPlane(bytes, plane);
  const auto width = static_cast<size_t>(plane.width());
  for (int y = 0; y < plane.height(); ++y) {
    DecodeValues(encoding, bytes, plane.Row(y), width);
    if (encoding != v1::PLANE_ENCODING_CONSTANT) bytes.remove_prefix(EncodedBytes(encoding, width));
  }
  return absl::OkStatus();
}

}  // namespace

v1::PixelLayout LayoutOf(const LayeredImage& image) {
  v1::PixelLayout layout;
  layout.set_width(image.width());
  layout.set_height(image.height());
  for (const LayeredImage::Channel& channel : image.channels()) layout.add_channels(channel.name);
  return layout;
}

EncodedPicture EncodePicture(const LayeredImage& image) {
  EncodedPicture picture{.layout = LayoutOf(image), .bytes = {}};
  PlaneCompressor compressor;
  for (const LayeredImage::Channel& channel : image.channels()) {
    const ConstFloatView plane = channel.plane.view();
    const v1::PlaneEncoding encoding = EncodingOf(plane);
    const uint32_t compressed =
        encoding == v1::PLANE_ENCODING_FLOAT ? compressor.Append(plane, &picture.bytes) : 0;
    if (compressed > 0) {
      picture.layout.add_encodings(v1::PLANE_ENCODING_ZSTD);
      picture.layout.add_compressed_bytes(compressed);
    } else {
      picture.layout.add_encodings(encoding);
      AppendPlane(plane, encoding, &picture.bytes);
    }
  }
  return picture;
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
  if (absl::Status status = CheckCompressedBytes(layout); !status.ok()) return status;
  return CheckNames(layout, limits);
}

uint64_t EncodedBytesOf(const v1::PixelLayout& layout) {
  const std::vector<EncodedPlane> planes = PlanesOf(layout);
  return planes.empty() ? 0 : planes.back().first_byte + planes.back().size_bytes;
}

std::string BytesFromImage(const LayeredImage& image) {
  std::string bytes;
  bytes.reserve(FloatBytesOf(LayoutOf(image)));
  for (const LayeredImage::Channel& channel : image.channels())
    AppendPlane(channel.plane.view(), v1::PLANE_ENCODING_FLOAT, &bytes);
  return bytes;
}

namespace {

/// `image`: a picture or list of the layout's size, without channels.
absl::StatusOr<LayeredImage> Decode(const v1::PixelLayout& layout, std::string_view bytes,
                                    const PixelLimits& limits, LayeredImage image) {
  if (absl::Status status = CheckLayout(layout, limits); !status.ok()) return status;
  if (bytes.size() != EncodedBytesOf(layout)) {
    return absl::InvalidArgumentError(
        absl::StrCat("pixels: ", bytes.size(), " bytes, the layout needs ", EncodedBytesOf(layout)));
  }
  const std::vector<EncodedPlane> planes = PlanesOf(layout);
  for (size_t i = 0; i < planes.size(); ++i) {
    const std::string& channel = layout.channels(static_cast<int>(i));
    const FloatView view = image.AddUninitialized(channel);
    const std::string_view encoded = bytes.substr(planes[i].first_byte, planes[i].size_bytes);
    if (absl::Status status = DecodePlane(planes[i].encoding, encoded, view); !status.ok())
      return CannotDecompress(channel, status);
  }
  return image;
}

}  // namespace

absl::StatusOr<LayeredImage> ImageFromBytes(const v1::PixelLayout& layout, std::string_view bytes,
                                            const PixelLimits& limits) {
  return Decode(layout, bytes, limits, LayeredImage(layout.width(), layout.height()));
}

absl::StatusOr<LayeredImage> ListFromBytes(const v1::PixelLayout& layout, std::string_view bytes,
                                           const PixelLimits& limits) {
  return Decode(layout, bytes, limits, LayeredImage::List(layout.width(), layout.height()));
}

bool PixelChunker::Next(v1::PixelChunk* chunk) {
  if (done_) return false;
  chunk->Clear();
  chunk->set_index(index_);
  if (index_ == 0) *chunk->mutable_layout() = std::move(picture_.layout);
  const size_t left = picture_.bytes.size() - sent_;
  done_ = left <= kMaxChunkBytes;
  if (done_ && sent_ == 0) {
    *chunk->mutable_data() = std::move(picture_.bytes);
  } else {
    chunk->set_data(picture_.bytes.data() + sent_, std::min(left, kMaxChunkBytes));
    sent_ += chunk->data().size();
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
