#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"

namespace lumifold::identity {

/// Maximum bytes of a code and of a token, as text.
inline constexpr size_t kMaxSecretTextBytes = 256;

/// Bytes of the operating system's generator of keys.
/// Errors: kInternal where it fails: there is nothing secure to go on with.
absl::StatusOr<std::string> RandomBytes(size_t count);

/// What a code and a token are made of: letters, digits, "-" and "_" (base64url without padding).
std::string SecretText(std::string_view bytes);

/// SHA-256 of bytes, as 32 bytes. Secrets of 128 random bits or more need no salt and no slow hash: none can
/// be guessed.
std::string HashOf(std::string_view bytes);

/// Bytes of the secret part of a code: 128 bits, for a day.
inline constexpr size_t kCodeSecretBytes = 16;

/// What an invited person or worker types: which authority to trust, and the right to one identity.
struct Code {
  std::string ca_sha256;  // 32 bytes: of the authority's certificate in DER
  std::string secret;     // kCodeSecretBytes random bytes, sent as SecretText
};

/// "lumifold-" and 64 characters.
std::string TextOfCode(const Code& code);

/// Errors: kInvalidArgument, which does not show the text.
absl::StatusOr<Code> ParseCode(std::string_view text);

/// A new token: "lumifold_" and 43 characters that stand for 256 random bits. The first part lets tools find
/// tokens that were published by mistake.
absl::StatusOr<std::string> MakeToken();

/// Makes this process leave no core dump and lets no other process of the user read its memory. For programs
/// that hold keys or tokens: a core dump is a file that others may read, often sent to a service that
/// collects crashes, and a limit of the dump's size does not hold for dumps that are piped to such a program.
void ProtectMemory();

}  // namespace lumifold::identity
