#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "proto/rpc/credentials.h"

namespace lumifold::bench {

/// How a load gets into its coordinator: in plain text, or over TLS with a token and a worker's certificate.
class LoadAccess {
 public:
  LoadAccess() = default;
  /// Sets up access control in the data folder of a coordinator that does not run yet. Profiles go to
  /// `config`.
  static absl::StatusOr<LoadAccess> SetUp(const std::string& data, const std::string& config);

  /// Logs in and enrols at the running coordinator. Nothing to do in plain text.
  absl::Status Join(const std::string& address);

  const rpc::Security& client() const { return client_; }
  const rpc::Security& worker() const { return worker_; }

 private:
  std::string config_;
  std::string client_code_;
  std::string worker_code_;
  rpc::Security client_;
  rpc::Security worker_;
};

}  // namespace lumifold::bench
