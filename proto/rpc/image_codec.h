#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
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

/// A picture as it is sent and stored.
struct EncodedPicture {
  v1::PixelLayout layout;
  std::string bytes;  // the encoded planes one after another
};

/// The picture with each plane as constant, half, zstd or float32, the first that can hold it. The bytes
/// depend on the version of zstd.
EncodedPicture EncodePicture(const LayeredImage& image);

/// Checks that a layout is valid and within `limits`: positive size, at least one channel, unique and
/// printable channel names, known encodings, sizes of compressed planes below those as float32.
/// Errors: kInvalidArgument naming the cause.
absl::Status CheckLayout(const v1::PixelLayout& layout, const PixelLimits& limits);

/// Bytes of the encoded planes. Of a layout that CheckLayout refuses the result has no meaning.
uint64_t EncodedBytesOf(const v1::PixelLayout& layout);

/// The planes as float32, in the order of LayoutOf.
std::string BytesFromImage(const LayeredImage& image);

/// The picture with this layout and these encoded planes. Decodes plane by plane: besides the picture, memory
/// holds one.
/// Errors: kInvalidArgument for an invalid layout, a size that does not fit it, or a plane that cannot be
/// decompressed.
absl::StatusOr<LayeredImage> ImageFromBytes(const v1::PixelLayout& layout, std::string_view bytes,
                                            const PixelLimits& limits);
/// The same for a list (LayeredImage::List). Its rows may have one value each; in a picture's planes each
/// would take a cache line.
absl::StatusOr<LayeredImage> ListFromBytes(const v1::PixelLayout& layout, std::string_view bytes,
                                           const PixelLimits& limits);

/// Cuts an encoded picture into PixelChunks.
class PixelChunker {
 public:
  explicit PixelChunker(const LayeredImage& image) : PixelChunker(EncodePicture(image)) {}
  explicit PixelChunker(EncodedPicture picture) : picture_(std::move(picture)) {}

  /// Fills `chunk` with the next piece; false after the last one.
  bool Next(v1::PixelChunk* chunk);

 private:
  EncodedPicture picture_;
  size_t sent_ = 0;  // bytes
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

/// Collects the chunks of a picture, in order, and keeps their bytes as they are. Its memory is bounded by
/// the bytes received, not by the announced size.
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
