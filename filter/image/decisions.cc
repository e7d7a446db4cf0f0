#include "filter/image/decisions.h"

#include <algorithm>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

namespace lumifold::decisions {
namespace {

std::optional<int> ParseValue(const Decision& decision, const std::string& text) {
  if (decision.IsSwitch()) {
    if (text == "on") return 1;
    if (text == "off") return 0;
    return std::nullopt;
  }
  int value = 0;
  if (!absl::SimpleAtoi(text, &value) || value < decision.least || value > decision.most) return std::nullopt;
  return value;
}

std::string AllNames() {
  return absl::StrJoin(kAll, ", ", [](std::string* text, const Decision& decision) {
    absl::StrAppend(text, std::string(decision.name));
  });
}

}  // namespace

const Decision* Find(std::string_view name) {
  const auto found =
      std::find_if(kAll.begin(), kAll.end(), [name](const Decision& d) { return d.name == name; });
  return found == kAll.end() ? nullptr : &*found;
}

std::string ValueText(const Decision& decision, int value) {
  if (decision.IsSwitch()) return value != 0 ? "on" : "off";
  return absl::StrCat(value);
}

absl::StatusOr<Values> ParseForced(absl::Span<const std::string> forced) {
  Values values;
  for (const std::string& text : forced) {
    const size_t equals = text.find('=');
    const std::string name = text.substr(0, equals);
    const Decision* const decision = Find(name);
    if (equals == std::string::npos || decision == nullptr) {
      return absl::InvalidArgumentError(
          absl::StrCat("'", text, "' is not NAME=VALUE with the name of a decision: ", AllNames()));
    }
    const std::optional<int> value = ParseValue(*decision, text.substr(equals + 1));
    if (!value.has_value()) {
      return absl::InvalidArgumentError(
          absl::StrCat("'", text, "': ", name, " is ",
                       decision->IsSwitch()
                           ? "on or off"
                           : absl::StrCat("a whole number from ", decision->least, " to ", decision->most)));
    }
    values[decision->name] = *value;
  }
  return values;
}

}  // namespace lumifold::decisions
