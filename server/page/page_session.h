#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "lumifold/v1/farm.pb.h"

namespace lumifold::page {

/// Makes and opens the sessions of links to the page. A session is sealed with a secret that browsers do not
/// have; nothing is kept of it, so that every coordinator with the secret knows it.
/// Threads: safe.
class SessionSeal {
 public:
  /// `key`: secret bytes.
  explicit SessionSeal(std::string key) : key_(std::move(key)) {}

  /// Text for the fragment of a URL.
  std::string Seal(const v1::PageSession& session) const;
  /// Errors: kUnauthenticated for a text that Seal has not made with this key, and after the session's end.
  absl::StatusOr<v1::PageSession> Open(absl::string_view text, absl::Time wall_now) const;
  /// Whether a session has not expired.
  static bool IsOpen(const v1::PageSession& session, absl::Time wall_now) {
    return wall_now < absl::FromUnixMillis(session.expires_unix_ms());
  }

 private:
  const std::string key_;
};

}  // namespace lumifold::page
