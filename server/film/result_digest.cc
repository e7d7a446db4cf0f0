#include "server/film/result_digest.h"

#include "absl/strings/str_cat.h"
#include "filter/image/file_io.h"
#include "proto/rpc/sha256.h"

namespace lumifold::film {
namespace {

constexpr int64_t kDigestFileBytes = 64;

std::string DigestPath(const std::string& result_path) { return absl::StrCat(result_path, ".sha256"); }

}  // namespace

absl::StatusOr<std::string> MakeResultDigest(const std::string& result_path, FileSystem* files) {
  absl::StatusOr<std::string> digest = rpc::Sha256HexOfFile(result_path);
  if (!digest.ok()) return digest;
  if (absl::Status status = WriteResultDigest(result_path, *digest, files); !status.ok()) return status;
  return digest;
}

absl::Status WriteResultDigest(const std::string& result_path, const std::string& digest, FileSystem* files) {
  return WriteFileAtomically(DigestPath(result_path), digest, files);
}

absl::StatusOr<std::string> ResultDigest(const std::string& result_path) {
  absl::StatusOr<std::string> kept = ReadFile(DigestPath(result_path), kDigestFileBytes);
  if (kept.ok() && rpc::IsSha256Hex(*kept)) return kept;
  return MakeResultDigest(result_path);
}

}  // namespace lumifold::film
