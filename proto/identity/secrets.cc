#include "proto/identity/secrets.h"

#include <openssl/rand.h>
#include <openssl/sha.h>
#include <sys/prctl.h>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "proto/identity/openssl.h"

namespace lumifold::identity {
namespace {

constexpr absl::string_view kCodePrefix = "lumifold-";
constexpr absl::string_view kTokenPrefix = "lumifold_";
constexpr size_t kHashBytes = SHA256_DIGEST_LENGTH;
constexpr size_t kTokenBytes = 32;
// 48 bytes need no padding: each text has one meaning.
constexpr size_t kCodeTextBytes = (kHashBytes + kCodeSecretBytes) / 3 * 4;

}  // namespace

absl::StatusOr<std::string> RandomBytes(size_t count) {
  std::string bytes(count, '\0');
  if (RAND_bytes(reinterpret_cast<unsigned char*>(bytes.data()), static_cast<int>(count)) != 1)
    return OpensslError("no random numbers");
  return bytes;
}

std::string SecretText(std::string_view bytes) {
  return absl::WebSafeBase64Escape({bytes.data(), bytes.size()});
}

std::string HashOf(std::string_view bytes) {
  std::string hash(kHashBytes, '\0');
  SHA256(reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size(),
         reinterpret_cast<unsigned char*>(hash.data()));
  return hash;
}

std::string TextOfCode(const Code& code) {
  return absl::StrCat(kCodePrefix, SecretText(code.ca_sha256 + code.secret));
}

absl::StatusOr<Code> ParseCode(std::string_view text) {
  absl::string_view rest(text.data(), text.size());
  std::string bytes;
  if (!absl::ConsumePrefix(&rest, kCodePrefix) || rest.size() != kCodeTextBytes ||
      !absl::WebSafeBase64Unescape(rest, &bytes) ||
      SecretText(bytes) != std::string_view(rest.data(), rest.size())) {
    return absl::InvalidArgumentError(
        absl::StrCat("this is not a code: one is '", kCodePrefix, "' and ", kCodeTextBytes, " characters"));
  }
  return Code{.ca_sha256 = bytes.substr(0, kHashBytes), .secret = bytes.substr(kHashBytes)};
}

absl::StatusOr<std::string> MakeToken() {
  const absl::StatusOr<std::string> bytes = RandomBytes(kTokenBytes);
  if (!bytes.ok()) return bytes.status();
  return absl::StrCat(kTokenPrefix, SecretText(*bytes));
}

void ProtectMemory() { prctl(PR_SET_DUMPABLE, 0); }

}  // namespace lumifold::identity
