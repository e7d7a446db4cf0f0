#include "proto/identity/certificate.h"

#include <arpa/inet.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/x509v3.h>

#include <array>
#include <ctime>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "proto/identity/openssl.h"
#include "proto/identity/secrets.h"

namespace lumifold::identity {
namespace {

std::string TextOfString(const ASN1_STRING* text) {
  return {reinterpret_cast<const char*>(ASN1_STRING_get0_data(text)),
          static_cast<size_t>(ASN1_STRING_length(text))};
}

std::string TextOfAddress(const ASN1_OCTET_STRING* bytes) {
  std::array<char, INET6_ADDRSTRLEN> text = {};
  const int family = ASN1_STRING_length(bytes) == 4 ? AF_INET : AF_INET6;
  if (family == AF_INET6 && ASN1_STRING_length(bytes) != 16) return "";
  inet_ntop(family, ASN1_STRING_get0_data(bytes), text.data(), text.size());
  return text.data();
}

absl::Time TimeOf(const ASN1_TIME* time) {
  std::tm fields = {};
  return ASN1_TIME_to_tm(time, &fields) == 1 ? absl::FromTimeT(timegm(&fields)) : absl::InfinitePast();
}

void ReadNames(X509* certificate, CertificateFacts* facts) {
  auto* names =
      static_cast<GENERAL_NAMES*>(X509_get_ext_d2i(certificate, NID_subject_alt_name, nullptr, nullptr));
  for (int i = 0; i < sk_GENERAL_NAME_num(names); ++i) {
    const GENERAL_NAME* name = sk_GENERAL_NAME_value(names, i);
    if (name->type == GEN_DNS) facts->hosts.push_back(TextOfString(name->d.dNSName));
    if (name->type == GEN_IPADD) facts->hosts.push_back(TextOfAddress(name->d.iPAddress));
    if (name->type == GEN_URI) facts->uris.push_back(TextOfString(name->d.uniformResourceIdentifier));
  }
  GENERAL_NAMES_free(names);
  const X509_NAME* subject = X509_get_subject_name(certificate);
  if (const int index = X509_NAME_get_index_by_NID(subject, NID_commonName, -1); index >= 0)
    facts->common_name = TextOfString(X509_NAME_ENTRY_get_data(X509_NAME_get_entry(subject, index)));
}

}  // namespace

absl::StatusOr<std::string> MakePrivateKey() {
  const OpensslPtr<EVP_PKEY> key(EVP_EC_gen("P-256"));
  const OpensslPtr<BIO> text(BIO_new(BIO_s_mem()));
  if (key == nullptr || text == nullptr ||
      PEM_write_bio_PKCS8PrivateKey(text.get(), key.get(), nullptr, nullptr, 0, nullptr, nullptr) != 1)
    return OpensslError("cannot make a private key");
  return TextOf(text.get());
}

absl::StatusOr<std::string> MakeCertificateRequest(std::string_view private_key_pem) {
  const OpensslPtr<EVP_PKEY> key(
      PEM_read_bio_PrivateKey(ReaderOf(private_key_pem).get(), nullptr, nullptr, nullptr));
  if (key == nullptr) {
    ERR_clear_error();
    return absl::InvalidArgumentError("not a private key in PEM");
  }
  const OpensslPtr<X509_REQ> request(X509_REQ_new());
  const OpensslPtr<BIO> text(BIO_new(BIO_s_mem()));
  if (request == nullptr || text == nullptr || X509_REQ_set_version(request.get(), X509_REQ_VERSION_1) != 1 ||
      X509_REQ_set_pubkey(request.get(), key.get()) != 1 ||
      X509_REQ_sign(request.get(), key.get(), EVP_sha256()) == 0 ||
      PEM_write_bio_X509_REQ(text.get(), request.get()) != 1)
    return OpensslError("cannot make a certificate request");
  return TextOf(text.get());
}

absl::StatusOr<CertificateFacts> ReadCertificate(std::string_view pem) {
  const OpensslPtr<X509> certificate(PEM_read_bio_X509(ReaderOf(pem).get(), nullptr, nullptr, nullptr));
  ERR_clear_error();
  if (certificate == nullptr) return absl::InvalidArgumentError("not a certificate in PEM");
  unsigned char* der = nullptr;
  const int size = i2d_X509(certificate.get(), &der);
  if (size <= 0) return OpensslError("cannot encode a certificate");
  CertificateFacts facts;
  facts.sha256 = HashOf({reinterpret_cast<const char*>(der), static_cast<size_t>(size)});
  OPENSSL_free(der);
  facts.not_before = TimeOf(X509_get0_notBefore(certificate.get()));
  facts.not_after = TimeOf(X509_get0_notAfter(certificate.get()));
  ReadNames(certificate.get(), &facts);
  return facts;
}

absl::Time ValidityClock() { return absl::Now(); }

absl::Status CheckNotExpired(const CertificateFacts& certificate, absl::Time now) {
  if (now < certificate.not_after) return absl::OkStatus();
  return absl::UnauthenticatedError(absl::StrCat(
      "the certificate of ", certificate.common_name,
      " has expired: ", absl::FormatTime(absl::RFC3339_sec, certificate.not_after, absl::UTCTimeZone())));
}

bool IsDueForRenewal(const CertificateFacts& certificate, absl::Time now) {
  return now >= certificate.not_before + (certificate.not_after - certificate.not_before) * 2 / 3;
}

}  // namespace lumifold::identity
