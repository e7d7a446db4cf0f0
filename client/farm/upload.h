#pragma once

#include <cstdint>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "client/cli/progress.h"
#include "client/farm/backoff.h"
#include "client/farm/farm_client.h"

namespace lumifold::client {

/// Sends one file of a scene. Goes on where an earlier upload stopped, and after a broken connection as long
/// as `backoff` allows. Bytes of an earlier upload that turn out to be wrong are sent again, once. Calls
/// `on_sent` with the position in the file, which decreases where an upload starts over.
/// Errors: those of FarmClient.
absl::Status UploadFile(FarmClient& farm, const LocalAsset& asset, Progress& progress, Backoff backoff,
                        absl::FunctionRef<void(uint64_t sent_bytes)> on_sent);

}  // namespace lumifold::client
