#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"

namespace lumifold::access {

/// Metadata of a call that a coordinator forwards to another one of its farm, in the name of its caller: a
/// seal, or any text in plain text. A call that has it is not forwarded again.
inline constexpr char kForwardedKey[] = "lumifold-forwarded-for";

/// Proves that a coordinator of the same authority has let a caller in: an HMAC-SHA256 over the caller's
/// credential and the time, with a key that only those have who have the authority's own. It is sent over TLS
/// only.
/// Threads: safe.
class ForwardSeal {
 public:
  /// `key`: secret bytes.
  explicit ForwardSeal(std::string key) : key_(std::move(key)) {}

  /// `credential`: Identity::id.
  std::string Make(absl::string_view credential, absl::Time wall_now) const;
  /// The credential of a seal that was made within some minutes, before or after `wall_now`: clocks differ.
  /// Errors: kUnauthenticated.
  absl::StatusOr<std::string> Open(absl::string_view seal, absl::Time wall_now) const;

 private:
  const std::string key_;
};

}  // namespace lumifold::access
