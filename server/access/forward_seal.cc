#include "server/access/forward_seal.h"

#include <cstdint>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "server/access/mac.h"

namespace lumifold::access {
namespace {

constexpr absl::Duration kLifetime = absl::Minutes(5);
constexpr size_t kMaxSealBytes = 512;

absl::Status NotSealed() {
  return absl::UnauthenticatedError("the call was not forwarded by a coordinator of this farm");
}

}  // namespace

// A seal is the time in milliseconds, the credential and the code in hexadecimal, with dots between them. A
// credential may have any characters.

std::string ForwardSeal::Make(absl::string_view credential, absl::Time wall_now) const {
  const std::string text = absl::StrCat(absl::ToUnixMillis(wall_now), ".", credential);
  return absl::StrCat(text, ".", MacOf(key_, text));
}

absl::StatusOr<std::string> ForwardSeal::Open(absl::string_view seal, absl::Time wall_now) const {
  const size_t first = seal.find('.');
  const size_t last = seal.rfind('.');
  if (seal.size() > kMaxSealBytes || first == absl::string_view::npos || first == last) return NotSealed();
  if (!IsMacOf(seal.substr(last + 1), key_, seal.substr(0, last))) return NotSealed();
  int64_t made_ms = 0;
  if (!absl::SimpleAtoi(seal.substr(0, first), &made_ms)) return NotSealed();
  if (absl::AbsDuration(wall_now - absl::FromUnixMillis(made_ms)) > kLifetime)
    return absl::UnauthenticatedError(
        "the call was forwarded too long ago, or the clocks of the coordinators differ");
  return std::string(seal.substr(first + 1, last - first - 1));
}

}  // namespace lumifold::access
