#include "server/picture/picture_code.h"

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "picture_sources.h"  // made when this is built

namespace lumifold::server {

std::string PictureCode() { return kPictureSources; }

bool SharesPictureCode(const std::string& numeric_class) {
  return absl::StrContains(numeric_class, absl::StrCat("-", kPictureSources, "-"));
}

}  // namespace lumifold::server
