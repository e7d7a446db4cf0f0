#pragma once

#include <memory>

#include "absl/status/statusor.h"
#include "client/farm/coordinators.h"
#include "lumifold/v1/access.pb.h"

namespace lumifold::client {

/// The client's interface to AccessService. Errors and threads as FarmClient.
class AccessClient {
 public:
  virtual ~AccessClient() = default;

  virtual absl::StatusOr<v1::WhoAmIResponse> WhoAmI() = 0;
  /// Not retried: a second call would make a second code.
  virtual absl::StatusOr<v1::CreateInviteResponse> CreateInvite(const v1::CreateInviteRequest& request) = 0;
  /// One page.
  virtual absl::StatusOr<v1::ListIdentitiesResponse> ListIdentities(
      const v1::ListIdentitiesRequest& request) = 0;
  virtual absl::StatusOr<v1::RevokeResponse> Revoke(const v1::RevokeRequest& request) = 0;
};

/// A client of the farm. Connects on first use.
std::unique_ptr<AccessClient> ConnectToAccess(FarmClientOptions options);

}  // namespace lumifold::client
