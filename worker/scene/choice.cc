#include "worker/scene/choice.h"

#include <algorithm>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "worker/scene/diagnostics.h"

namespace lumifold::scene {
namespace {

/// "0 'front', 1 'top'"; the first ones of many.
std::string Listed(const std::vector<std::string>& names) {
  constexpr size_t kMost = 20;
  std::string text;
  for (size_t i = 0; i < std::min(names.size(), kMost); ++i) {
    absl::StrAppend(&text, i == 0 ? "" : ", ", i);
    if (!names[i].empty()) absl::StrAppend(&text, " '", OneLine(names[i]), "'");
  }
  if (names.size() > kMost) absl::StrAppend(&text, " and ", names.size() - kMost, " more");
  return text;
}

}  // namespace

absl::StatusOr<int> Choose(const char* kind, const std::vector<std::string>& names,
                           const std::string& wanted) {
  const auto found = std::find(names.begin(), names.end(), wanted);
  if (found != names.end()) return static_cast<int>(found - names.begin());
  int number = 0;
  if (absl::SimpleAtoi(wanted, &number) && number >= 0 && static_cast<size_t>(number) < names.size())
    return number;
  return absl::NotFoundError(absl::StrCat(
      "the scene has no ", kind, " called '", OneLine(wanted), "'; ",
      names.empty() ? absl::StrCat("it has no ", kind) : absl::StrCat("there are: ", Listed(names))));
}

}  // namespace lumifold::scene
