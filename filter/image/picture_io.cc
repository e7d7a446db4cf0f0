#include "filter/image/picture_io.h"

#include <string_view>
#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/image/exr_io.h"
#include "filter/image/hdr_io.h"

namespace lumifold {
namespace {

constexpr std::string_view kExrMagic = "\x76\x2f\x31\x01";

}  // namespace

absl::StatusOr<LayeredImage> DecodeLinearPicture(const std::string& name, std::string_view bytes) {
  if (LooksLikeHdr(bytes)) return DecodeHdr(name, bytes);
  if (!bytes.starts_with(kExrMagic)) {
    return absl::InvalidArgumentError(absl::StrCat(name, ": neither an OpenEXR nor a Radiance picture"));
  }
  absl::StatusOr<LayeredImage> read = DecodeExr(name, bytes);
  if (!read.ok()) return read.status();
  LayeredImage picture(read->width(), read->height());
  const bool grey = !read->HasColor("") && read->Has("Y");
  if (!grey && !read->HasColor("")) {
    return absl::InvalidArgumentError(absl::StrCat(name, ": has neither channels R, G, B nor Y"));
  }
  for (const char* channel : {"R", "G", "B"}) {
    CopyPlane(std::as_const(*read).Get(grey ? "Y" : channel), picture.Add(channel));
  }
  return picture;
}

}  // namespace lumifold
