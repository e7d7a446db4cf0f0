#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/types/span.h"
#include "filter/image/layered_image.h"
#include "lumifold/v1/image.pb.h"

namespace lumifold::rpc {

/// Maximum size of a received picture.
struct PixelLimits {
  int max_width = 16384;
  int max_height = 16384;
  int max_channels = 256;
  int max_name_length = 64;
  /// Bytes of all planes as float32, however few their encodings take.
  uint64_t max_bytes = uint64_t{1} << 32;
};

/// Layout of `image` with all planes as float32, without its metadata.
v1::PixelLayout LayoutOf(const LayeredImage& image);

/// LayoutOf with the encodings in which a PixelChunker sends the planes.
v1::PixelLayout EncodedLayoutOf(const LayeredImage& image);

/// Checks that a layout is valid and within `limits`: positive size, at least one channel, unique and
/// printable channel names, known encodings.
/// Errors: kInvalidArgument naming the cause.
absl::Status CheckLayout(const v1::PixelLayout& layout, const PixelLimits& limits);

/// Bytes of the encoded planes. Of a layout that CheckLayout refuses the result has no meaning.
uint64_t EncodedBytesOf(const v1::PixelLayout& layout);

/// The planes as float32, in the order of LayoutOf.
std::string BytesFromImage(const LayeredImage& image);

/// The picture with this layout and these encoded planes.
/// Errors: kInvalidArgument for an invalid layout or a size that does not fit it.
absl::StatusOr<LayeredImage> ImageFromBytes(const v1::PixelLayout& layout, std::string_view bytes,
                                            const PixelLimits& limits);

/// Encodes a picture as PixelChunks. The picture must outlive it and must not change.
class PixelChunker {
 public:
  explicit PixelChunker(const LayeredImage& image);

  /// Fills `chunk` with the next piece; false after the last one.
  bool Next(v1::PixelChunk* chunk);

 private:
  const LayeredImage& image_;
  v1::PixelLayout layout_;
  size_t next_plane_ = 0;
  std::string encoded_;  // bytes of the planes before next_plane_ that are not sent
  uint32_t index_ = 0;
  bool done_ = false;
};

/// Bytes of planes that arrived in one chunk.
struct PixelPiece {
  std::string bytes;
  /// XXH3-64 of `bytes`.
  uint64_t checksum = 0;
};

/// XXH3-64 of the pieces one after another.
uint64_t ChecksumOf(absl::Span<const PixelPiece> pieces);

/// A picture in the form in which it arrived: its encoded planes in pieces of kMaxChunkBytes, the last
/// of which may be smaller. A picture that never arrived has no channels and no pieces.
struct ReceivedPicture {
  v1::PixelLayout layout;
  std::vector<PixelPiece> pieces;
};

/// Collects the chunks of a picture, in order, and keeps their bytes as they are. Its memory is bounded by the
/// bytes received, not by the announced size.
/// Threads: one at a time.
class PixelAssembler {
 public:
  explicit PixelAssembler(PixelLimits limits = {}) : limits_(limits) {}

  /// Adds the next chunk; one that is moved in is not copied.
  /// Errors: kInvalidArgument for chunks out of order, an invalid layout or sizes that do not fit it;
  /// kDataLoss when a checksum does not match. After an error every further call fails with the same error.
  absl::Status Add(v1::PixelChunk chunk);

  /// True after the last chunk.
  bool IsComplete() const { return complete_; }

  /// The layout; nullopt before the first chunk.
  const std::optional<v1::PixelLayout>& layout() const { return layout_; }

  /// Bytes of the pieces in memory.
  uint64_t HeldBytes() const;

  /// The picture, which must be complete. Leaves the assembler empty.
  ReceivedPicture Take();

 private:
  absl::Status CheckChunk(const v1::PixelChunk& chunk);

  PixelLimits limits_;
  absl::Status failure_;
  std::optional<v1::PixelLayout> layout_;
  std::vector<PixelPiece> pieces_;
  uint64_t received_bytes_ = 0;
  bool complete_ = false;
};

}  // namespace lumifold::rpc
