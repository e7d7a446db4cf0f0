#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "server/access/identity.h"

namespace lumifold::access {

/// What the certificate of a worker or a person says of it, besides its common name: "lumifold:worker:NAME"
/// or "lumifold:person:NAME", and "lumifold:serial:SERIAL", so that a call need not parse a certificate to
/// know whose it is.
inline constexpr char kWorkerUri[] = "lumifold:worker:";
inline constexpr char kPersonUri[] = "lumifold:person:";
inline constexpr char kSerialUri[] = "lumifold:serial:";

/// Signs certificates of workers, people and coordinators with a P-256 key. The key is in the folder of
/// access control; it never leaves it.
/// Threads: safe.
class CertificateAuthority {
 public:
  /// Makes a new authority, valid for ten years from `now`, in `folder`, which exists: ca.pem and ca.key.
  /// Errors: kUnavailable naming the file; kInternal where OpenSSL fails.
  static absl::Status Create(const std::string& folder, absl::Time now);
  /// Errors: also kInvalidArgument for files that do not belong together.
  static absl::StatusOr<std::unique_ptr<CertificateAuthority>> Open(const std::string& folder);
  virtual ~CertificateAuthority() = default;

  /// Its certificate in PEM, and the SHA-256 of its DER form (32 bytes).
  virtual const std::string& pem() const = 0;
  virtual const std::string& sha256() const = 0;

  /// Secret bytes that only those know who have the key of the authority; another text for each `purpose`.
  virtual std::string SecretFor(std::string_view purpose) const = 0;

  /// A certificate for servers of these names (DNS names and IP addresses) with a new key. Returns the key,
  /// the certificate and the authority's, as one PEM text.
  /// Errors: kInvalidArgument naming the host.
  virtual absl::StatusOr<std::string> SignServer(const std::vector<std::string>& hosts, absl::Time now,
                                                 absl::Duration lifetime) const = 0;

  struct ClientCertificate {
    std::string pem;
    std::string serial;  // 32 hexadecimal digits
    std::string sha256;
    absl::Time expires;
  };
  /// A certificate for a worker or a person, for connections as a client only. Of the request only the key
  /// counts, which must be P-256 and have signed it.
  /// Errors: kInvalidArgument for what is no such request.
  virtual absl::StatusOr<ClientCertificate> SignClient(IdentityKind kind, const std::string& name,
                                                       std::string_view request_pem, absl::Time now,
                                                       absl::Duration lifetime) const = 0;
};

/// "localhost", "127.0.0.1" and "::1", which are in every server's certificate, and `names`, each once.
std::vector<std::string> HostsOfServer(const std::vector<std::string>& names);

/// Of the hosts in a server's certificate the one by which other machines reach it: `machine`, its own name,
/// if that is among them or there are none; otherwise the first that is not each machine's own.
std::string HostForOthers(const std::vector<std::string>& certified, const std::string& machine);

/// Whether `host` is an IP address or a DNS name.
absl::Status CheckHost(const std::string& host);

}  // namespace lumifold::access
