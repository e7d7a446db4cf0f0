#include "worker/certificate_renewal.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "proto/identity/certificate.h"
#include "proto/identity/join.h"
#include "proto/identity/private_file.h"

namespace lumifold::worker {
namespace {

constexpr absl::Duration kLongestPause = absl::Hours(1);
constexpr absl::Duration kShortestPause = absl::Seconds(1);
/// Looks during the life of a certificate: a third of them are left when it is due, so many attempts may fail.
constexpr int kLooks = 60;

}  // namespace

CertificateRenewal::CertificateRenewal(CertificateRenewalOptions options) : options_(std::move(options)) {
  if (options_.profile.empty()) return;
  thread_ = std::thread([this] {
    while (!stop_.WaitFor(Look())) continue;
  });
}

CertificateRenewal::~CertificateRenewal() {
  stop_.Notify();
  if (thread_.joinable()) thread_.join();
}

absl::Duration CertificateRenewal::Look() const {
  const std::string path = options_.profiles.CertificatePath(options_.profile);
  const absl::StatusOr<std::string> pem = identity::ReadPrivateFile(path, identity::kMaxCertificateFileBytes);
  const absl::StatusOr<identity::CertificateFacts> certificate =
      pem.ok() ? identity::ReadCertificate(*pem) : pem.status();
  if (!certificate.ok()) {
    options_.log->error("event=certificate_unreadable path=\"{}\" error=\"{}\"", path,
                        std::string(certificate.status().message()));
    return kLongestPause;
  }
  if (identity::IsDueForRenewal(*certificate, options_.wall_now())) {
    const absl::StatusOr<v1::CertificateResponse> renewed =
        identity::RenewCertificate(options_.profiles, options_.profile);
    if (renewed.ok()) {
      options_.log->info(
          "event=certificate_renewed expires={}",
          absl::FormatTime(absl::FromUnixMillis(renewed->expires_unix_ms()), absl::UTCTimeZone()));
    } else {
      options_.log->warn("event=certificate_not_renewed expires={} error=\"{}\"",
                         absl::FormatTime(certificate->not_after, absl::UTCTimeZone()),
                         std::string(renewed.status().message()));
    }
  }
  return std::clamp((certificate->not_after - certificate->not_before) / kLooks, kShortestPause,
                    kLongestPause);
}

}  // namespace lumifold::worker
