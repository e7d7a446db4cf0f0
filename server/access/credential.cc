#include "server/access/credential.h"

#include <algorithm>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

namespace lumifold::access {

absl::Status CheckCredentialName(const std::string& name) {
  const auto is_alnum = [](char c) { return absl::ascii_isalnum(static_cast<unsigned char>(c)); };
  constexpr absl::string_view kSigns = "._-@:";
  const bool is_name = !name.empty() && name.size() <= kMaxNameBytes && is_alnum(name.front()) &&
                       std::all_of(name.begin(), name.end(), [&](char c) {
                         return is_alnum(c) || kSigns.find(c) != absl::string_view::npos;
                       });
  if (is_name) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(
      "name: must be 1 to ", kMaxNameBytes, " letters, digits and \". _ - @ :\", a letter or digit first"));
}

}  // namespace lumifold::access
