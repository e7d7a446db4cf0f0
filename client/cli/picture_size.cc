#include "client/cli/picture_size.h"

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"

namespace lumifold::client {
namespace {

// Digits only: SimpleAtoi also accepts signs and spaces.
bool ParseEdge(absl::string_view text, int* edge) {
  for (const char c : text) {
    if (!absl::ascii_isdigit(static_cast<unsigned char>(c))) return false;
  }
  return absl::SimpleAtoi(text, edge) && *edge >= 1 && *edge <= kMaxEdge;
}

}  // namespace

absl::StatusOr<PictureSize> ParsePictureSize(absl::string_view text) {
  const size_t cross = text.find('x');
  const bool has_height = cross != absl::string_view::npos;
  PictureSize size;
  size.height = 0;
  if (ParseEdge(text.substr(0, cross), &size.width) &&
      (!has_height || ParseEdge(text.substr(cross + 1), &size.height)))
    return size;
  return absl::InvalidArgumentError(absl::StrCat("expected WIDTHxHEIGHT or WIDTH in pixels, 1 to ", kMaxEdge,
                                                 " each, such as 512x384; got '", text, "'"));
}

}  // namespace lumifold::client
