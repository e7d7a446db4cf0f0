#pragma once

#include <memory>

#include "absl/status/statusor.h"
#include "client/cli/local_work.h"

namespace lumifold::local {

/// Starts a coordinator and a worker inside this process, connected by an in-process channel, for `lumifold
/// render`. They run the same code as the daemons, so the picture is bit-identical to that of a farm; frames
/// are filtered in this process, at its priority.
/// Errors: those of server::Server::Start, such as a state folder that another coordinator uses; kUnavailable
/// if no temporary folder can be created; those of device::OpenDevice.
absl::StatusOr<std::unique_ptr<client::LocalFarm>> StartLocalFarm(const client::LocalFarmOptions& options);

}  // namespace lumifold::local
