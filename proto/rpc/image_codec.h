#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "filter/image/layered_image.h"
#include "lumifold/v1/image.pb.h"

namespace lumifold::rpc {

/// How large a picture the receiving side is ready to take.
struct PixelLimits {
  int max_width = 16384;
  int max_height = 16384;
  int max_channels = 256;
  int max_name_length = 64;
  /// Of all planes together.
  uint64_t max_bytes = uint64_t{1} << 32;
};

/// What `image` is, without its pixels. Metadata is not part of it.
v1::PixelLayout LayoutOf(const LayeredImage& image);

/// Checks that a layout is sane and within `limits`: positive size, at least one channel, names that are
/// unique, short and printable.
/// Errors: kInvalidArgument naming what is wrong.
absl::Status CheckLayout(const v1::PixelLayout& layout, const PixelLimits& limits);

/// Bytes the planes of a checked layout take.
uint64_t BytesOf(const v1::PixelLayout& layout);

/// The planes one after another, as PixelLayout says.
std::string BytesFromImage(const LayeredImage& image);

/// The inverse of BytesFromImage. Errors: kInvalidArgument for a bad layout or a size that does not fit it.
absl::StatusOr<LayeredImage> ImageFromBytes(const v1::PixelLayout& layout, std::string_view bytes,
                                            const PixelLimits& limits);

/// Cuts a picture into PixelChunks. The picture must outlive it and stay as it is.
class PixelChunker {
 public:
  explicit PixelChunker(const LayeredImage& image);

  /// Fills `chunk` with the next piece; false when the last one has been given.
  bool Next(v1::PixelChunk* chunk);

 private:
  const LayeredImage& image_;
  uint64_t total_bytes_;
  uint64_t sent_bytes_ = 0;
  uint32_t index_ = 0;
  bool done_ = false;
};

/// Puts a picture together again from chunks in order. Memory grows with what has arrived, never with what
/// was announced.
/// Threads: one at a time.
class PixelAssembler {
 public:
  explicit PixelAssembler(PixelLimits limits = {}) : limits_(limits) {}

  /// Takes the next piece.
  /// Errors: kInvalidArgument for pieces out of order, a bad layout or sizes that do not fit it; kDataLoss
  /// when a checksum does not agree. After an error every further call fails with it.
  absl::Status Add(const v1::PixelChunk& chunk);

  /// True once the last piece has been taken.
  bool IsComplete() const { return complete_; }

  /// The layout; nothing before the first piece.
  const std::optional<v1::PixelLayout>& layout() const { return layout_; }

  /// Bytes held now.
  uint64_t HeldBytes() const;

  /// The picture, which must be complete. Leaves the assembler empty.
  LayeredImage Take();

 private:
  absl::Status CheckChunk(const v1::PixelChunk& chunk);
  void Append(std::string_view bytes);

  PixelLimits limits_;
  absl::Status failure_;
  std::optional<v1::PixelLayout> layout_;
  std::vector<Plane> planes_;
  uint64_t received_bytes_ = 0;
  uint32_t next_index_ = 0;
  bool complete_ = false;
};

}  // namespace lumifold::rpc
