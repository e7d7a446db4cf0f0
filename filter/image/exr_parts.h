#pragma once

#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfMultiPartInputFile.h>

#include <cstdint>
#include <string>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "filter/image/layered_image.h"

// Shared by the readers and writers of OpenEXR in filter/image; no other code needs OpenEXR headers.
namespace lumifold {

/// Names of the parts of a picture with lists, see EdgedImage.
inline constexpr char kExrFilmPart[] = "picture";
inline constexpr char kExrEdgePart[] = "edges";
inline constexpr char kExrFragmentPart[] = "fragments";

/// Name of the part with R G B A where each layer is a part.
inline constexpr char kExrPicturePart[] = "rgba";

/// Runs `body` and converts its exceptions into a Status that names `path`. OpenEXR is only called in here.
absl::Status CatchExr(const std::string& path, absl::FunctionRef<absl::Status()> body);

/// A slice whose pixel (x0, y0) is the view's first. When OpenEXR writes a file, it only reads the view.
Imf::Slice ExrSliceOf(FloatView view, int x0, int y0);

/// Slices of all channels of `image`, whose first pixel is (x0, y0) of the file.
Imf::FrameBuffer ExrFrameOf(const LayeredImage& image, int x0, int y0);

/// Whether this library reads the parts and headers of the file, which has `file_bytes` bytes: checks the
/// sizes that the headers claim before memory is taken for them.
/// Errors: kInvalidArgument naming the file.
absl::Status CheckExr(const std::string& path, const Imf::MultiPartInputFile& file, uint64_t file_bytes);

/// The same for a file whose picture may be in several parts, all of the same window; then come the lists.
absl::Status CheckLayeredExr(const std::string& path, const Imf::MultiPartInputFile& file,
                             uint64_t file_bytes);

/// The name that a channel of a part has among those of the whole picture: its own in the first part or where
/// it names its layer, else that of the part before it ("diffuse.R").
std::string ExrChannelName(const Imf::MultiPartInputFile& file, int part, const std::string& channel);

/// Whether a part has this name.
bool IsExrPart(const Imf::Header& header, const char* name);

/// Whether a part is an edge set or fragments.
bool IsExrList(const Imf::Header& header);

/// The string attributes of a header.
std::map<std::string, std::string> ExrMetadata(const Imf::Header& header);

/// What a picture that is made of a file keeps of it: its windows and all attributes, those apart that say
/// how its pixels are stored.
struct ExrOrigin {
  Imf::Header header;
};

/// A header with the windows and the attributes of `origin`, and without channels.
Imf::Header ExrHeaderOf(const ExrOrigin& origin);

/// An image of zeros with the part's channels, a list if the part is one.
LayeredImage ExrImage(const Imf::Header& header, int width, int height);

}  // namespace lumifold
