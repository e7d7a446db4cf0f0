#include "server/picture/picture_code.h"

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "picture_sources.h"  // made when this is built

namespace lumifold::server {

std::string PictureCode() { return kPictureSources; }

bool SharesPictureCode(const std::string& numeric_class, const std::string& other_bits) {
  const char* const plus = other_bits.empty() ? "" : "+";
  return absl::StrContains(numeric_class, absl::StrCat("-", kPictureSources, plus, other_bits, "-"));
}

std::string ClassOfPicture(const std::string& numeric_class, const std::string& other_bits) {
  const std::string name = absl::StrCat("+", other_bits);
  if (other_bits.empty() || absl::StrContains(numeric_class, name)) return numeric_class;
  return numeric_class + name;
}

}  // namespace lumifold::server
