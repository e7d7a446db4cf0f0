#include "proto/rpc/sha256.h"

#include <fcntl.h>
#include <openssl/evp.h>

#include <algorithm>
#include <cerrno>
#include <limits>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "filter/image/check.h"
#include "filter/image/file_calls.h"
#include "proto/rpc/byte_stream.h"
#include "proto/rpc/limits.h"

namespace lumifold::rpc {
namespace {

constexpr uint64_t kToTheEnd = std::numeric_limits<uint64_t>::max();

// Adds at most `bytes` bytes of a file. Returns how many there were.
absl::StatusOr<uint64_t> AddFile(const std::string& path, uint64_t bytes, Sha256* sum) {
  const FileHandle file(open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (file.get() < 0) return FileError(path, errno);
  std::string buffer(kMaxChunkBytes, '\0');
  uint64_t done = 0;
  while (done < bytes) {
    const int64_t n = ReadNext(file.get(), buffer.data(), std::min<uint64_t>(buffer.size(), bytes - done));
    if (n < 0) return FileError(path, n);
    if (n == 0) break;
    sum->Update({buffer.data(), static_cast<size_t>(n)});
    done += static_cast<uint64_t>(n);
  }
  return done;
}

}  // namespace

Sha256::Sha256() : context_(EVP_MD_CTX_new()) {
  LUMIFOLD_CHECK(context_ != nullptr && EVP_DigestInit_ex(context_, EVP_sha256(), nullptr) == 1);
}

Sha256::~Sha256() { EVP_MD_CTX_free(context_); }

void Sha256::Update(std::string_view bytes) {
  LUMIFOLD_CHECK(EVP_DigestUpdate(context_, bytes.data(), bytes.size()) == 1);
}

std::string Sha256::FinishHex() {
  unsigned char digest[EVP_MAX_MD_SIZE];
  unsigned size = 0;
  LUMIFOLD_CHECK(EVP_DigestFinal_ex(context_, digest, &size) == 1);
  return absl::BytesToHexString(absl::string_view(reinterpret_cast<const char*>(digest), size));
}

std::string Sha256Hex(std::string_view bytes) {
  Sha256 sum;
  sum.Update(bytes);
  return sum.FinishHex();
}

absl::Status AddFileStart(const std::string& path, uint64_t bytes, Sha256* sum) {
  const absl::StatusOr<uint64_t> added = AddFile(path, bytes, sum);
  if (!added.ok()) return added.status();
  if (*added == bytes) return absl::OkStatus();
  return absl::DataLossError(absl::StrCat(path, ": has ", *added, " bytes, not ", bytes));
}

absl::StatusOr<std::string> Sha256HexOfFile(const std::string& path) {
  Sha256 sum;
  const absl::StatusOr<uint64_t> added = AddFile(path, kToTheEnd, &sum);
  if (!added.ok()) return added.status();
  return sum.FinishHex();
}

bool IsSha256Hex(std::string_view text) {
  return text.size() == 64 && std::all_of(text.begin(), text.end(), [](char c) {
           return absl::ascii_isdigit(static_cast<unsigned char>(c)) || (c >= 'a' && c <= 'f');
         });
}

}  // namespace lumifold::rpc
