#include "worker/connection/certificate_renewal.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "proto/identity/certificate.h"
#include "proto/identity/join.h"
#include "proto/logging/fields.h"

namespace lumifold::worker {
namespace {

constexpr absl::Duration kLongestPause = absl::Hours(1);
constexpr absl::Duration kShortestPause = absl::Seconds(1);
/// Looks during the life of a certificate: a third of them are left when it is due, so many attempts may
/// fail.
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

absl::Status CertificateRenewal::CheckNotExpired() const {
  if (options_.profile.empty()) return absl::OkStatus();
  const absl::StatusOr<identity::CertificateFacts> certificate =
      options_.profiles.CertificateOf(options_.profile);
  // One that cannot be read now may be readable later; Look says so.
  return certificate.ok() ? identity::CheckNotExpired(*certificate, options_.wall_now()) : absl::OkStatus();
}

absl::Duration CertificateRenewal::Look() const {
  const absl::StatusOr<identity::CertificateFacts> certificate =
      options_.profiles.CertificateOf(options_.profile);
  if (!certificate.ok()) {
    options_.log->error("event=certificate_unreadable profile={} error={}", options_.profile,
                        logging::Quoted(certificate.status().message()));
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
      options_.log->warn("event=certificate_not_renewed expires={} error={}",
                         absl::FormatTime(certificate->not_after, absl::UTCTimeZone()),
                         logging::Quoted(renewed.status().message()));
    }
  }
  return std::clamp((certificate->not_after - certificate->not_before) / kLooks, kShortestPause,
                    kLongestPause);
}

}  // namespace lumifold::worker
