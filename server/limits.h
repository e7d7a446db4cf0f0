#pragma once

#include "server/assets/asset_store.h"
#include "server/coordinator/options.h"
#include "server/net/connection_limits.h"
#include "server/services/call_limits.h"

namespace lumifold::server {

/// What callers may take of a coordinator. docs/operations.md lists all.
struct Limits {
  CallLimits calls;
  ConnectionLimits connections;
  JobLimits jobs;
  AssetLimits assets = {.asset_bytes = 64'000'000'000};
};

}  // namespace lumifold::server
