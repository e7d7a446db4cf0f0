#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "filter/image/edged_image.h"
#include "filter/image/layered_image.h"

namespace lumifold {

/// The most pixels that any reader accepts in a picture: 2^28 (16384 x 16384). It keeps a damaged header from
/// exhausting memory.
inline constexpr int64_t kMaxPixels = int64_t{1} << 28;

/// Sets the threads (>= 1) that compress and decompress all OpenEXR files that this process opens from now
/// on. Until it is called, the calling thread does so alone. It affects the whole process, so only programs
/// call it. The bytes do not depend on the number.
void SetExrThreads(int threads);

/// Writes every channel as 32-bit float in ZIP-compressed scan lines, and metadata as string attributes. The
/// file is written atomically (temporary file, sync, rename). The same picture gives the same bytes.
/// Errors:  kInvalidArgument for a picture without channels or pixels; kUnavailable with the system's message
///          if the file cannot be written.
/// Threads: safe for different paths.
absl::Status WriteExr(const std::string& path, const LayeredImage& image);

/// The same for a picture with its lists, which become parts called "edges" and "fragments". If they are
/// empty, the file has one part, as above.
absl::Status WriteExr(const std::string& path, const EdgedImage& image);

/// Reads all channels of a picture as float, and its string attributes as metadata. Lists are ignored.
/// Errors: kNotFound; kInvalidArgument naming the file for anything that is not a complete OpenEXR picture
/// (deep files, several parts other than lists, a truncated file, a size over kMaxPixels).
absl::StatusOr<LayeredImage> ReadExr(const std::string& path);

/// Reads a file of WriteExr with its lists.
/// Errors: as ReadExr.
absl::StatusOr<EdgedImage> ReadEdgedExr(const std::string& path);

/// ReadExr for a file's bytes in memory; errors begin with `name`.
absl::StatusOr<LayeredImage> DecodeExr(const std::string& name, std::string_view bytes);

}  // namespace lumifold
