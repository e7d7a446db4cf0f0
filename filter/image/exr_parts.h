#pragma once

#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfMultiPartInputFile.h>

#include <array>
#include <string>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "filter/image/layered_image.h"

// What reading and writing OpenEXR share. For filter/image alone: others need no OpenEXR headers.
namespace lumifold {

/// The parts of a picture with an edge set.
inline constexpr std::array<const char*, 2> kExrPartNames = {"picture", "edges"};

/// Runs `body`, the only place where OpenEXR is called, and turns what it throws into a Status that names
/// `path`.
absl::Status CatchExr(const std::string& path, absl::FunctionRef<absl::Status()> body);

/// A slice whose pixel (x0, y0) is the view's first; the view's pixels are only read when OpenEXR writes.
Imf::Slice ExrSliceOf(FloatView view, int x0, int y0);

/// Slices of all channels of `image`, whose first pixel is (x0, y0) of the file; as above.
Imf::FrameBuffer ExrFrameOf(const LayeredImage& image, int x0, int y0);

/// Whether all parts and their headers are what we read. Errors: kInvalidArgument naming the file.
absl::Status CheckExr(const std::string& path, const Imf::MultiPartInputFile& file);

/// The string attributes.
std::map<std::string, std::string> ExrMetadata(const Imf::Header& header);

/// A picture of zeros with the part's channels.
LayeredImage ExrImage(const Imf::Header& header, int width, int height);

}  // namespace lumifold
