#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace lumifold::webhooks {

/// Maximum bytes of the URL of a webhook.
inline constexpr size_t kMaxUrlBytes = 1024;

/// The URL of a webhook, taken apart by the library that will call it.
struct Target {
  /// Normalised.
  std::string url;
  /// SCHEME://HOST:PORT, in lower case and always with a port.
  std::string origin;
};

/// Errors: kInvalidArgument saying what is wrong, without the URL: it may have a secret in its path.
absl::StatusOr<Target> ParseTarget(const std::string& url);

/// Where an operator lets webhooks be.
/// Threads: safe.
class AllowedHosts {
 public:
  /// `list`: HOST or HOST:PORT, with commas between them; empty: none. A host without a port is allowed with
  /// the ports of http and https, 80 and 443.
  /// Errors: kInvalidArgument naming the entry.
  static absl::StatusOr<AllowedHosts> Parse(absl::string_view list);

  const std::vector<std::string>& origins() const { return origins_; }
  /// Errors: those of ParseTarget; kFailedPrecondition where no host is allowed; kPermissionDenied naming a
  /// host that is not.
  absl::StatusOr<Target> Check(const std::string& url) const;

 private:
  std::vector<std::string> origins_;
};

}  // namespace lumifold::webhooks
