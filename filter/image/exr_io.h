#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "filter/image/edged_image.h"
#include "filter/image/layered_image.h"

namespace lumifold {

/// Pixels a picture may have at most, over all readers: 2^28 (16384 x 16384), so that a damaged header cannot
/// ask for all memory.
inline constexpr int64_t kMaxPixels = int64_t{1} << 28;

/// Compresses and decompresses all OpenEXR files that this process opens from now on with `threads` (>= 1)
/// threads; before it is called, with the caller's own. For programs: a library does not decide for its
/// process. The bytes are the same with any number.
void SetExrThreads(int threads);

/// Writes every channel as 32-bit float, ZIP-compressed scanlines, metadata as string attributes. The file
/// appears whole or not at all (written beside itself, synced, renamed). Errors: kInvalidArgument for a
/// picture without channels or pixels; kUnavailable with the system's words when the disk refuses. Threads:
/// safe for different paths. The same picture gives the same bytes.
absl::Status WriteExr(const std::string& path, const LayeredImage& image);

/// The same for a picture with its edge set, which becomes a second part called "edges". Without edges the
/// file has one part, as above.
absl::Status WriteExr(const std::string& path, const EdgedImage& image);

/// Reads all channels of a picture as float, and its string attributes as metadata. An edge set beside it is
/// left out.
/// Errors: kNotFound; kInvalidArgument naming the file for anything that is not a whole OpenEXR picture (deep
/// files, those of several parts but an edge set's, a file cut short, a size over kMaxPixels).
absl::StatusOr<LayeredImage> ReadExr(const std::string& path);

/// Reads what WriteExr wrote, edge set and all. Errors: as ReadExr.
absl::StatusOr<EdgedImage> ReadEdgedExr(const std::string& path);

/// The same for a file's bytes in memory; `name` is what errors call it.
absl::StatusOr<LayeredImage> DecodeExr(const std::string& name, std::string_view bytes);

}  // namespace lumifold
