#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"

namespace lumifold::identity {

/// Maximum bytes of a certificate request, of a certificate and of a file of both, in PEM.
inline constexpr size_t kMaxRequestBytes = 8192;
inline constexpr size_t kMaxCertificateFileBytes = 65536;

/// A new P-256 private key, PKCS#8 in PEM.
/// Errors: kInternal where OpenSSL fails.
absl::StatusOr<std::string> MakePrivateKey();

/// A request (PKCS#10 in PEM) to certify a private key. It names nobody: the authority chooses the name.
/// Errors: kInvalidArgument for what is no private key.
absl::StatusOr<std::string> MakeCertificateRequest(std::string_view private_key_pem);

/// What a certificate says.
struct CertificateFacts {
  std::string sha256;  // 32 bytes, of the certificate in DER
  std::string common_name;
  std::vector<std::string> hosts;  // DNS names and IP addresses, in the certificate's order
  std::vector<std::string> uris;
  absl::Time not_before;
  absl::Time not_after;
};

/// Reads the first certificate of a PEM text; other blocks before it, such as a key, are skipped.
/// Errors: kInvalidArgument for what has none.
absl::StatusOr<CertificateFacts> ReadCertificate(std::string_view pem);

/// The time that validity is compared with: the wall clock, as certificates and tokens name dates. Nothing is
/// measured with it.
absl::Time ValidityClock();

/// Errors: kUnauthenticated naming the holder where the certificate has expired: nobody takes it, not even to
/// renew it.
absl::Status CheckNotExpired(const CertificateFacts& certificate, absl::Time now);

/// Whether a certificate that is valid from `not_before` to `not_after` should be replaced: two thirds of its
/// life are over.
bool IsDueForRenewal(const CertificateFacts& certificate, absl::Time now);

}  // namespace lumifold::identity
