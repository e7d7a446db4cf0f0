#include "worker/scene/uri.h"

#include <cstdint>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/string_view.h"

namespace lumifold::scene {
namespace {

constexpr std::string_view kDataScheme = "data:";

/// Debian's absl has a string_view of its own.
absl::string_view View(std::string_view text) { return {text.data(), text.size()}; }

bool IsHexPair(std::string_view text) {
  return text.size() >= 2 && absl::ascii_isxdigit(static_cast<unsigned char>(text[0])) &&
         absl::ascii_isxdigit(static_cast<unsigned char>(text[1]));
}

}  // namespace

std::string PercentDecode(std::string_view text) {
  std::string decoded;
  decoded.reserve(text.size());
  for (size_t i = 0; i < text.size(); ++i) {
    uint32_t byte = 0;
    if (text[i] == '%' && IsHexPair(text.substr(i + 1)) &&
        absl::SimpleHexAtoi(View(text.substr(i + 1, 2)), &byte)) {
      decoded += static_cast<char>(byte);
      i += 2;
    } else {
      decoded += text[i];
    }
  }
  return decoded;
}

bool IsDataUri(std::string_view uri) { return absl::StartsWithIgnoreCase(View(uri), View(kDataScheme)); }

absl::StatusOr<std::string> DecodeDataUri(std::string_view uri) {
  const size_t comma = uri.find(',');
  if (comma == std::string_view::npos) return absl::InvalidArgumentError("a data: URI without a comma");
  const std::string_view header = uri.substr(kDataScheme.size(), comma - kDataScheme.size());
  const std::string_view content = uri.substr(comma + 1);
  if (!absl::EndsWithIgnoreCase(View(header), ";base64")) return PercentDecode(content);
  std::string decoded;
  if (!absl::Base64Unescape(View(content), &decoded)) {
    return absl::InvalidArgumentError("a data: URI that is not valid base64");
  }
  return decoded;
}

}  // namespace lumifold::scene
