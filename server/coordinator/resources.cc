#include "server/coordinator/resources.h"

#include <string>
#include <utility>

#include "proto/logging/job_labels.h"
#include "proto/retry/storage_away.h"

namespace lumifold::server {

Resources::Resources(const CoordinatorOptions& the_options, const DataFolder& the_folder,
                     ledger::JobStore* the_store, AssetStore* the_assets, FrameFinisher* the_finisher,
                     ledger::Owner the_owner)
    : options(the_options),
      folder(the_folder),
      store(the_store),
      assets(the_assets),
      finisher(the_finisher),
      owner(std::move(the_owner)),
      storage(options.wall_now, options.log),
      webhooks(*webhooks::Webhooks::Open({}, {.log = options.log})) {
  storage.OnChange(options.notify.on_storage_change);
}

absl::Status Resources::NoteError(const absl::Status& status) {
  if (!absl::IsUnavailable(status)) return status;
  storage.Fail(status);
  return retry::StorageAway(status);
}

void Resources::LabelJob(const job::JobId& job, const v1::Scheduling& scheduling) const {
  if (options.job_log.labels == nullptr) return;
  options.job_log.labels->Set(job.value(), {.trace = scheduling.trace_id(), .user = scheduling.user()});
}

}  // namespace lumifold::server
