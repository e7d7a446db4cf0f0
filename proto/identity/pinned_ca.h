#pragma once

#include <optional>
#include <string>

#include "absl/status/statusor.h"
#include "absl/time/time.h"

namespace lumifold::identity {

/// The certificate, in PEM, of the authority whose SHA-256 (32 bytes) a code has. The server at HOST:PORT
/// sends it in a TLS handshake that verifies nothing and over which nothing is sent: only the hash counts.
/// Whoever answers in the server's place can at most send the right certificate, and then fails the verified
/// handshake that follows.
/// Errors: kUnavailable where the address cannot be reached or does not speak TLS within `timeout`;
/// kUnauthenticated where its authority is another.
absl::StatusOr<std::string> FetchPinnedCa(const std::string& address, const std::string& ca_sha256,
                                          absl::Duration timeout);

/// Whether what listens at HOST:PORT is encrypted: it makes a TLS handshake, or answers the beginning of
/// HTTP/2 in plain text. For the words of an error: nothing is verified. nullopt: neither within `timeout`.
std::optional<bool> IsEncrypted(const std::string& address, absl::Duration timeout);

}  // namespace lumifold::identity
