#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

struct evp_md_ctx_st;

namespace lumifold::rpc {

/// SHA-256 of a sequence of pieces.
/// Threads: one at a time.
class Sha256 {
 public:
  Sha256();
  ~Sha256();
  Sha256(const Sha256&) = delete;
  Sha256& operator=(const Sha256&) = delete;

  void Update(std::string_view bytes);

  /// The digest as 64 lower-case hexadecimal digits, as in AssetRef. Call it once, last.
  std::string FinishHex();

 private:
  evp_md_ctx_st* context_;
};

/// The SHA-256 of `bytes` in hexadecimal.
std::string Sha256Hex(std::string_view bytes);

/// The first `bytes` bytes of a file, added to `sum`.
/// Errors: kNotFound naming the file; kDataLoss if it is shorter; kUnavailable with the system's message.
absl::Status AddFileStart(const std::string& path, uint64_t bytes, Sha256* sum);

/// The SHA-256 of a file in hexadecimal.
/// Errors: kNotFound naming the file; kUnavailable with the system's message.
absl::StatusOr<std::string> Sha256HexOfFile(const std::string& path);

/// Whether `text` is 64 lower-case hexadecimal digits. Such a text is safe as a file name.
bool IsSha256Hex(std::string_view text);

}  // namespace lumifold::rpc
