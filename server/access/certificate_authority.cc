#include "server/access/certificate_authority.h"

#include <arpa/inet.h>
#include <openssl/err.h>
#include <openssl/hmac.h>
#include <openssl/pem.h>
#include <openssl/x509v3.h>

#include <algorithm>
#include <array>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "filter/image/check.h"
#include "proto/identity/certificate.h"
#include "proto/identity/openssl.h"
#include "proto/identity/private_file.h"
#include "proto/identity/secrets.h"
#include "server/access/credential.h"

namespace lumifold::access {
namespace {

using identity::OpensslError;
using identity::OpensslPtr;

constexpr absl::Duration kAuthorityLifetime = absl::Hours(24 * 3652);
/// Clocks of machines differ: a certificate is valid from this long before it is made, but not from so long
/// before that the time of its renewal, which counts from there, changes much.
absl::Duration ClockSkew(absl::Duration lifetime) { return std::min(absl::Minutes(5), lifetime / 20); }

constexpr size_t kSerialBytes = 16;
constexpr size_t kMaxHostBytes = 253;

bool IsAddress(const std::string& host) {
  std::array<unsigned char, 16> bytes = {};
  return inet_pton(AF_INET, host.c_str(), bytes.data()) == 1 ||
         inet_pton(AF_INET6, host.c_str(), bytes.data()) == 1;
}

std::string PemOf(X509* certificate) {
  const OpensslPtr<BIO> text(BIO_new(BIO_s_mem()));
  return PEM_write_bio_X509(text.get(), certificate) == 1 ? identity::TextOf(text.get()) : "";
}

bool AddExtension(X509* certificate, X509* issuer, int kind, const std::string& value) {
  X509V3_CTX context;
  X509V3_set_ctx(&context, issuer, certificate, nullptr, nullptr, 0);
  const OpensslPtr<X509_EXTENSION> extension(X509V3_EXT_conf_nid(nullptr, &context, kind, value.c_str()));
  return extension != nullptr && X509_add_ext(certificate, extension.get(), -1) == 1;
}

/// What is the same in all certificates. The serial number is 127 random bits, so that it is positive.
struct Base {
  OpensslPtr<X509> certificate;
  std::string serial;
};
absl::StatusOr<Base> MakeBase(const std::string& common_name, EVP_PKEY* key, absl::Time now,
                              absl::Duration lifetime) {
  absl::StatusOr<std::string> serial = identity::RandomBytes(kSerialBytes);
  if (!serial.ok()) return serial.status();
  serial->front() = static_cast<char>((serial->front() & 0x7f) | 0x40);  // as many digits each time
  const OpensslPtr<BIGNUM> number(BN_bin2bn(reinterpret_cast<const unsigned char*>(serial->data()),
                                            static_cast<int>(serial->size()), nullptr));
  OpensslPtr<X509> certificate(X509_new());
  if (number == nullptr || certificate == nullptr) return OpensslError("cannot make a certificate");
  X509* const made = certificate.get();
  const auto* name = reinterpret_cast<const unsigned char*>(common_name.data());
  if (X509_set_version(made, X509_VERSION_3) != 1 ||
      BN_to_ASN1_INTEGER(number.get(), X509_get_serialNumber(made)) == nullptr ||
      ASN1_TIME_set(X509_getm_notBefore(made), absl::ToTimeT(now - ClockSkew(lifetime))) == nullptr ||
      ASN1_TIME_set(X509_getm_notAfter(made), absl::ToTimeT(now + lifetime)) == nullptr ||
      X509_NAME_add_entry_by_NID(X509_get_subject_name(made), NID_commonName, MBSTRING_UTF8, name,
                                 static_cast<int>(common_name.size()), -1, 0) != 1 ||
      X509_set_pubkey(made, key) != 1)
    return OpensslError("cannot make a certificate");
  return Base{.certificate = std::move(certificate), .serial = absl::BytesToHexString(*serial)};
}

absl::StatusOr<OpensslPtr<EVP_PKEY>> ReadKey(std::string_view pem) {
  OpensslPtr<EVP_PKEY> key(PEM_read_bio_PrivateKey(identity::ReaderOf(pem).get(), nullptr, nullptr, nullptr));
  ERR_clear_error();
  if (key == nullptr) return absl::InvalidArgumentError("not a private key in PEM");
  return key;
}

bool IsP256(EVP_PKEY* key) {
  std::array<char, 64> group = {};
  size_t size = 0;
  return EVP_PKEY_get_group_name(key, group.data(), group.size(), &size) == 1 &&
         std::string_view(group.data(), size) == SN_X9_62_prime256v1;
}

/// The key of a request, if it has signed the request.
absl::StatusOr<OpensslPtr<EVP_PKEY>> KeyOfRequest(std::string_view pem) {
  const absl::Status bad = absl::InvalidArgumentError(
      "certificate_request_pem: not a certificate request in PEM with a P-256 key");
  if (pem.size() > identity::kMaxRequestBytes) return bad;
  const OpensslPtr<X509_REQ> request(
      PEM_read_bio_X509_REQ(identity::ReaderOf(pem).get(), nullptr, nullptr, nullptr));
  OpensslPtr<EVP_PKEY> key(request == nullptr ? nullptr : X509_REQ_get_pubkey(request.get()));
  const bool is_good = key != nullptr && IsP256(key.get()) && X509_REQ_verify(request.get(), key.get()) == 1;
  ERR_clear_error();
  if (!is_good) return bad;
  return key;
}

class OpensslAuthority final : public CertificateAuthority {
 public:
  OpensslAuthority(OpensslPtr<EVP_PKEY> key, OpensslPtr<X509> certificate, std::string pem,
                   std::string sha256)
      : key_(std::move(key)),
        certificate_(std::move(certificate)),
        pem_(std::move(pem)),
        sha256_(std::move(sha256)) {}

  const std::string& pem() const override { return pem_; }
  const std::string& sha256() const override { return sha256_; }

  std::string SecretFor(std::string_view purpose) const override {
    unsigned char* der = nullptr;
    const int size = i2d_PrivateKey(key_.get(), &der);
    LUMIFOLD_CHECK(size > 0);  // a key that was read can be written
    std::array<unsigned char, EVP_MAX_MD_SIZE> secret = {};
    unsigned int secret_size = 0;
    HMAC(EVP_sha256(), der, size, reinterpret_cast<const unsigned char*>(purpose.data()), purpose.size(),
         secret.data(), &secret_size);
    OPENSSL_clear_free(der, static_cast<size_t>(size));
    return {reinterpret_cast<const char*>(secret.data()), secret_size};
  }

  absl::StatusOr<std::string> SignServer(const std::vector<std::string>& hosts, absl::Time now,
                                         absl::Duration lifetime) const override {
    std::vector<std::string> names;
    for (const std::string& host : hosts) {
      if (absl::Status status = CheckHost(host); !status.ok()) return status;
      names.push_back(absl::StrCat(IsAddress(host) ? "IP:" : "DNS:", host));
    }
    absl::StatusOr<std::string> key_pem = identity::MakePrivateKey();
    if (!key_pem.ok()) return key_pem.status();
    const absl::StatusOr<OpensslPtr<EVP_PKEY>> key = ReadKey(*key_pem);
    if (!key.ok()) return key.status();
    const absl::StatusOr<Base> base = MakeBase("Lumifold coordinator", key->get(), now, lifetime);
    if (!base.ok()) return base.status();
    absl::StatusOr<std::string> certificate = Sign(*base, "serverAuth", absl::StrJoin(names, ","));
    if (!certificate.ok()) return certificate.status();
    return absl::StrCat(*key_pem, *certificate, pem_);
  }

  absl::StatusOr<ClientCertificate> SignClient(IdentityKind kind, const std::string& name,
                                               std::string_view request_pem, absl::Time now,
                                               absl::Duration lifetime) const override {
    // A comma in it would add names to the certificate.
    if (absl::Status status = CheckCredentialName(name); !status.ok()) return status;
    const absl::StatusOr<OpensslPtr<EVP_PKEY>> key = KeyOfRequest(request_pem);
    if (!key.ok()) return key.status();
    const absl::StatusOr<Base> base = MakeBase(name, key->get(), now, lifetime);
    if (!base.ok()) return base.status();
    const absl::StatusOr<std::string> pem =
        Sign(*base, "clientAuth",
             absl::StrCat("URI:", kind == IdentityKind::kWorker ? kWorkerUri : kPersonUri, name,
                          ",URI:", kSerialUri, base->serial));
    if (!pem.ok()) return pem.status();
    const absl::StatusOr<identity::CertificateFacts> facts = identity::ReadCertificate(*pem);
    if (!facts.ok()) return facts.status();
    return ClientCertificate{
        .pem = *pem, .serial = base->serial, .sha256 = facts->sha256, .expires = facts->not_after};
  }

 private:
  /// A certificate for one use: the key of a worker must not pass as a server's, nor the other way round.
  absl::StatusOr<std::string> Sign(const Base& base, const std::string& use, const std::string& names) const {
    X509* const made = base.certificate.get();
    X509* const issuer = certificate_.get();
    if (X509_set_issuer_name(made, X509_get_subject_name(issuer)) != 1 ||
        !AddExtension(made, issuer, NID_basic_constraints, "critical,CA:FALSE") ||
        !AddExtension(made, issuer, NID_key_usage, "critical,digitalSignature") ||
        !AddExtension(made, issuer, NID_ext_key_usage, use) ||
        !AddExtension(made, issuer, NID_subject_alt_name, names) ||
        !AddExtension(made, issuer, NID_subject_key_identifier, "hash") ||
        !AddExtension(made, issuer, NID_authority_key_identifier, "keyid:always") ||
        X509_sign(made, key_.get(), EVP_sha256()) == 0)
      return OpensslError("cannot sign a certificate");
    std::string pem = PemOf(made);
    if (pem.empty()) return OpensslError("cannot encode a certificate");
    return pem;
  }

  const OpensslPtr<EVP_PKEY> key_;
  const OpensslPtr<X509> certificate_;
  const std::string pem_;
  const std::string sha256_;
};

std::string CaPath(const std::string& folder) { return folder + "/ca.pem"; }
std::string CaKeyPath(const std::string& folder) { return folder + "/ca.key"; }

bool Contains(const std::vector<std::string>& hosts, const std::string& host) {
  return std::find(hosts.begin(), hosts.end(), host) != hosts.end();
}

}  // namespace

absl::Status CheckHost(const std::string& host) {
  const auto is_label = [](absl::string_view label) {
    return !label.empty() && label.size() <= 63 && label.front() != '-' && label.back() != '-' &&
           std::all_of(label.begin(), label.end(),
                       [](char c) { return absl::ascii_isalnum(static_cast<unsigned char>(c)) || c == '-'; });
  };
  const std::vector<std::string> labels = absl::StrSplit(host, '.');
  if (IsAddress(host) ||
      (host.size() <= kMaxHostBytes && std::all_of(labels.begin(), labels.end(), is_label)))
    return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat("'", absl::Utf8SafeCEscape(host.substr(0, kMaxHostBytes)),
                                                 "' is no host name and no IP address"));
}

std::vector<std::string> HostsOfServer(const std::vector<std::string>& names) {
  std::vector<std::string> hosts = {"localhost", "127.0.0.1", "::1"};
  for (const std::string& name : names) {
    if (!Contains(hosts, name)) hosts.push_back(name);
  }
  return hosts;
}

std::string HostForOthers(const std::vector<std::string>& certified, const std::string& machine) {
  if (certified.empty() || Contains(certified, machine)) return machine;
  const std::vector<std::string> own = HostsOfServer({});
  for (const std::string& host : certified) {
    if (!Contains(own, host)) return host;
  }
  return certified.front();
}

absl::Status CertificateAuthority::Create(const std::string& folder, absl::Time now) {
  const absl::StatusOr<std::string> key_pem = identity::MakePrivateKey();
  if (!key_pem.ok()) return key_pem.status();
  const absl::StatusOr<OpensslPtr<EVP_PKEY>> key = ReadKey(*key_pem);
  if (!key.ok()) return key.status();
  const absl::StatusOr<Base> base = MakeBase("Lumifold authority", key->get(), now, kAuthorityLifetime);
  if (!base.ok()) return base.status();
  X509* const made = base->certificate.get();
  if (X509_set_issuer_name(made, X509_get_subject_name(made)) != 1 ||
      !AddExtension(made, made, NID_basic_constraints, "critical,CA:TRUE,pathlen:0") ||
      !AddExtension(made, made, NID_key_usage, "critical,keyCertSign,cRLSign") ||
      !AddExtension(made, made, NID_subject_key_identifier, "hash") ||
      X509_sign(made, key->get(), EVP_sha256()) == 0)
    return OpensslError("cannot sign a certificate");
  absl::Status status = identity::WritePrivateFile(CaKeyPath(folder), *key_pem);
  if (status.ok()) status = identity::WritePrivateFile(CaPath(folder), PemOf(made));
  return status;
}

absl::StatusOr<std::unique_ptr<CertificateAuthority>> CertificateAuthority::Open(const std::string& folder) {
  absl::StatusOr<std::string> pem =
      identity::ReadPrivateFile(CaPath(folder), identity::kMaxCertificateFileBytes);
  if (!pem.ok()) return pem.status();
  const absl::StatusOr<std::string> key_pem =
      identity::ReadPrivateFile(CaKeyPath(folder), identity::kMaxCertificateFileBytes);
  if (!key_pem.ok()) return key_pem.status();
  absl::StatusOr<OpensslPtr<EVP_PKEY>> key = ReadKey(*key_pem);
  const absl::StatusOr<identity::CertificateFacts> facts = identity::ReadCertificate(*pem);
  OpensslPtr<X509> certificate(PEM_read_bio_X509(identity::ReaderOf(*pem).get(), nullptr, nullptr, nullptr));
  const bool belong_together = key.ok() && facts.ok() && certificate != nullptr &&
                               X509_check_private_key(certificate.get(), key->get()) == 1;
  ERR_clear_error();
  if (!belong_together) {
    return absl::InvalidArgumentError(absl::StrCat(CaPath(folder), " and ", CaKeyPath(folder),
                                                   " are not a certificate and its private key"));
  }
  return std::make_unique<OpensslAuthority>(*std::move(key), std::move(certificate), *std::move(pem),
                                            facts->sha256);
}

}  // namespace lumifold::access
