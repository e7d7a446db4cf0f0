#pragma once

#include <functional>
#include <memory>
#include <string>
#include <thread>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "proto/identity/profile.h"
#include "proto/threads/event.h"

namespace spdlog {
class logger;
}  // namespace spdlog

namespace lumifold::worker {

struct CertificateRenewalOptions {
  identity::Profiles profiles;
  /// Of the worker; empty: the connection is in plain text, and there is nothing to renew.
  std::string profile;
  std::function<absl::Time()> wall_now;
  std::shared_ptr<spdlog::logger> log;
};

/// Renews a worker's certificate when two thirds of its life are over, on a thread of its own. gRPC reads the
/// new file for new connections; the coordinator asks for one well before the old certificate expires.
class CertificateRenewal {
 public:
  explicit CertificateRenewal(CertificateRenewalOptions options);
  ~CertificateRenewal();

  /// Errors: kUnauthenticated where the certificate has expired. OK where there is none.
  absl::Status CheckNotExpired() const;

 private:
  /// Looks at the certificate, renews it if it is due, and returns the time until the next look.
  absl::Duration Look() const;

  const CertificateRenewalOptions options_;
  threads::Event stop_;
  std::thread thread_;  // last: it uses the members above
};

}  // namespace lumifold::worker
