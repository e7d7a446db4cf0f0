#include "proto/http/message.h"

#include <cstdint>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_split.h"

namespace lumifold::http {
namespace {

/// Text of a form: "%2C" is a comma, "+" a space.
std::string Decoded(absl::string_view text) {
  std::string decoded;
  while (!text.empty()) {
    uint32_t byte = 0;
    const bool is_escaped = text[0] == '%' && text.size() > 2 && absl::ascii_isxdigit(text[1]) &&
                            absl::SimpleHexAtoi(text.substr(1, 2), &byte);
    decoded += is_escaped ? static_cast<char>(byte) : text[0] == '+' ? ' ' : text[0];
    text.remove_prefix(is_escaped ? 3 : 1);
  }
  return decoded;
}

}  // namespace

absl::string_view Request::Header(absl::string_view name) const {
  for (const auto& [other, value] : headers) {
    if (absl::EqualsIgnoreCase(other, name)) return value;
  }
  return "";
}

std::optional<std::string> Request::Parameter(absl::string_view name) const {
  for (const absl::string_view parameter : absl::StrSplit(query, '&')) {
    const std::pair<absl::string_view, absl::string_view> pair =
        absl::StrSplit(parameter, absl::MaxSplits('=', 1));
    if (Decoded(pair.first) == name) return Decoded(pair.second);
  }
  return std::nullopt;
}

}  // namespace lumifold::http
