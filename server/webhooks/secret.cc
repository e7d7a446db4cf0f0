#include "server/webhooks/secret.h"

#include <filesystem>
#include <system_error>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "proto/identity/private_file.h"
#include "proto/identity/secrets.h"

namespace lumifold::webhooks {
namespace {

constexpr size_t kSecretBytes = 32;
constexpr size_t kMinSecretCharacters = 16;
constexpr int64_t kMaxFileBytes = 4096;

absl::Status MakeSecret(const std::string& path) {
  const absl::StatusOr<std::string> bytes = identity::RandomBytes(kSecretBytes);
  if (!bytes.ok()) return bytes.status();
  const absl::StatusOr<std::string> suffix = identity::RandomBytes(sizeof(uint64_t));
  if (!suffix.ok()) return suffix.status();
  const std::string made = absl::StrCat(path, ".", absl::BytesToHexString(*suffix));
  absl::Status status = identity::WritePrivateFile(made, absl::StrCat(absl::BytesToHexString(*bytes), "\n"));
  if (!status.ok()) return status;
  // Of several coordinators the first one's counts: a link replaces nothing.
  std::error_code error;
  std::filesystem::create_hard_link(made, path, error);
  std::error_code ignored;
  std::filesystem::remove(made, ignored);
  if (!error || error == std::errc::file_exists) return absl::OkStatus();
  return absl::UnavailableError(absl::StrCat(path, ": ", error.message()));
}

}  // namespace

absl::StatusOr<std::string> ReadSecret(const std::string& path) {
  const absl::StatusOr<std::string> file = identity::ReadPrivateFile(path, kMaxFileBytes);
  if (!file.ok()) return file.status();
  const std::vector<std::string> lines = absl::StrSplit(*file, absl::MaxSplits('\n', 1));
  const absl::string_view secret = absl::StripAsciiWhitespace(lines.front());
  if (secret.size() < kMinSecretCharacters)
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": its first line has fewer than ", kMinSecretCharacters, " characters"));
  return std::string(secret);
}

absl::StatusOr<std::string> ReadOrMakeSecret(const std::string& path) {
  absl::StatusOr<std::string> secret = ReadSecret(path);
  if (!absl::IsNotFound(secret.status())) return secret;
  if (absl::Status status = MakeSecret(path); !status.ok()) return status;
  return ReadSecret(path);
}

}  // namespace lumifold::webhooks
