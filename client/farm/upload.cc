#include "client/farm/upload.h"

#include <algorithm>
#include <string>

#include "absl/strings/str_cat.h"

namespace lumifold::client {

absl::Status UploadFile(FarmClient& farm, const LocalAsset& asset, Progress& progress, Backoff backoff,
                        absl::FunctionRef<void(uint64_t)> on_sent) {
  uint64_t most_received = 0;
  bool started_over = false;
  bool lost = false;
  while (true) {
    const absl::StatusOr<uint64_t> received = farm.FindUpload(asset.ref);
    absl::Status status = received.status();
    if (received.ok()) {
      // Only what the coordinator has counts as progress, not what was sent.
      if (*received > most_received) backoff.Reset();
      most_received = std::max(most_received, *received);
      status = farm.UploadAsset(asset, *received, on_sent);
      if (status.ok()) return status;
      if (absl::IsDataLoss(status) && *received > 0 && !started_over) {
        started_over = true;
        continue;
      }
    }
    if (!absl::IsUnavailable(status)) return status;
    if (!lost) progress.Message(absl::StrCat(status.message(), "; trying again"));
    lost = true;
    if (!backoff.Pause()) return status;
  }
}

}  // namespace lumifold::client
