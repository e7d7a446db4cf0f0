#pragma once

#include <openssl/bio.h>
#include <openssl/evp.h>
#include <openssl/ssl.h>
#include <openssl/x509.h>

#include <memory>
#include <string>
#include <string_view>

#include "absl/status/status.h"

// Owners of OpenSSL's objects. For the sources of this folder and of the certificate authority.

namespace lumifold::identity {

struct OpensslDelete {
  void operator()(ASN1_INTEGER* object) const { ASN1_INTEGER_free(object); }
  void operator()(BIGNUM* object) const { BN_free(object); }
  void operator()(BIO* object) const { BIO_free_all(object); }
  void operator()(EVP_PKEY* object) const { EVP_PKEY_free(object); }
  void operator()(SSL* object) const { SSL_free(object); }
  void operator()(SSL_CTX* object) const { SSL_CTX_free(object); }
  void operator()(X509* object) const { X509_free(object); }
  void operator()(X509_EXTENSION* object) const { X509_EXTENSION_free(object); }
  void operator()(X509_REQ* object) const { X509_REQ_free(object); }
};
template <typename T>
using OpensslPtr = std::unique_ptr<T, OpensslDelete>;

/// "WHAT: reason" with the first reason that OpenSSL recorded on this thread, which it then forgets.
absl::Status OpensslError(const char* what);

/// A reader of `bytes`, which must outlive it, and what was written to a BIO of BIO_s_mem.
OpensslPtr<BIO> ReaderOf(std::string_view bytes);
std::string TextOf(BIO* memory);

}  // namespace lumifold::identity
