#pragma once

#include <functional>
#include <memory>
#include <string>

#include "absl/status/statusor.h"

namespace grpc {
class Channel;
}  // namespace grpc

namespace lumifold::client {

/// A coordinator and a worker inside this process. Destroying it stops both and removes what it keeps nowhere
/// else.
class LocalFarm {
 public:
  virtual ~LocalFarm() = default;

  /// The way to its coordinator; valid as long as the farm lives.
  virtual std::shared_ptr<grpc::Channel> channel() = 0;
};

struct LocalFarmOptions {
  /// Render threads, at least 1.
  int threads = 1;
  /// Where the ledger and the results are kept; empty for a temporary folder that goes with the farm.
  std::string state_dir;
};

/// Starts a local farm. The program passes it in, so that the client library links neither coordinator nor
/// worker.
using LocalFarmFactory =
    std::function<absl::StatusOr<std::unique_ptr<LocalFarm>>(const LocalFarmOptions& options)>;

}  // namespace lumifold::client
