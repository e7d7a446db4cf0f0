#include "proto/identity/openssl.h"

#include <openssl/err.h>

#include <array>

#include "absl/strings/str_cat.h"

namespace lumifold::identity {

absl::Status OpensslError(const char* what) {
  std::array<char, 256> reason = {};
  if (const unsigned long code = ERR_get_error(); code != 0)
    ERR_error_string_n(code, reason.data(), reason.size());
  ERR_clear_error();
  return absl::InternalError(absl::StrCat(what, ": ", reason[0] == '\0' ? "OpenSSL failed" : reason.data()));
}

OpensslPtr<BIO> ReaderOf(std::string_view bytes) {
  return OpensslPtr<BIO>(BIO_new_mem_buf(bytes.data(), static_cast<int>(bytes.size())));
}

std::string TextOf(BIO* memory) {
  char* text = nullptr;
  const long size = BIO_get_mem_data(memory, &text);
  return size > 0 ? std::string(text, static_cast<size_t>(size)) : std::string();
}

}  // namespace lumifold::identity
