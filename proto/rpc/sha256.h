#pragma once

#include <memory>
#include <string>
#include <string_view>

struct evp_md_ctx_st;

namespace lumifold::rpc {

/// SHA-256 of bytes that come in pieces. Threads: one at a time.
class Sha256 {
 public:
  Sha256();
  ~Sha256();
  Sha256(const Sha256&) = delete;
  Sha256& operator=(const Sha256&) = delete;

  void Update(std::string_view bytes);

  /// 64 lower-case hexadecimal digits, as AssetRef holds them. Ends the sum: call it once, last.
  std::string FinishHex();

 private:
  evp_md_ctx_st* context_;
};

/// The SHA-256 of `bytes` in hexadecimal.
std::string Sha256Hex(std::string_view bytes);

/// Whether `text` can be the result of Sha256Hex: 64 lower-case hexadecimal digits. What passes is safe as a
/// file name.
bool IsSha256Hex(std::string_view text);

}  // namespace lumifold::rpc
