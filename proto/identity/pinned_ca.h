#pragma once

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

}  // namespace lumifold::identity
