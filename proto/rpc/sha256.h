#pragma once

#include <memory>
#include <string>
#include <string_view>

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

/// Whether `text` is 64 lower-case hexadecimal digits. Such a text is safe as a file name.
bool IsSha256Hex(std::string_view text);

}  // namespace lumifold::rpc
