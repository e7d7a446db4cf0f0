#pragma once

#include <memory>

#include "absl/status/statusor.h"
#include "client/local_farm.h"

namespace lumifold::local {

/// A coordinator and a worker inside this process, joined by a channel that touches no network: what
/// `lumifold render` runs on. The same code as the daemons', so the picture is the farm's, bit for bit.
/// Errors: those of server::Server::Start, such as a state folder that another coordinator owns; kUnavailable
/// without a temporary one.
absl::StatusOr<std::unique_ptr<client::LocalFarm>> StartLocalFarm(const client::LocalFarmOptions& options);

}  // namespace lumifold::local
