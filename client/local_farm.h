#pragma once

#include <functional>
#include <memory>
#include <string>

#include "absl/status/statusor.h"

namespace grpc {
class Channel;
}  // namespace grpc

namespace lumifold::client {

/// A coordinator and a worker inside this process. Its destruction stops both and removes temporary files.
class LocalFarm {
 public:
  virtual ~LocalFarm() = default;

  /// A channel to its coordinator; valid until the farm is destroyed.
  virtual std::shared_ptr<grpc::Channel> channel() = 0;
};

struct LocalFarmOptions {
  /// Render threads, at least 1.
  int threads = 1;
  /// Data folder of the coordinator; empty for a temporary folder that is removed with the farm.
  std::string state_dir;
};

/// Starts a local farm. The program passes this function in, so that the client library links neither
/// coordinator nor worker.
using LocalFarmFactory =
    std::function<absl::StatusOr<std::unique_ptr<LocalFarm>>(const LocalFarmOptions& options)>;

}  // namespace lumifold::client
