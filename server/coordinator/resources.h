#pragma once

#include <memory>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "server/coordinator/options.h"
#include "server/ledger/job_store.h"
#include "server/metrics/farm_timings.h"
#include "server/metrics/traffic.h"
#include "server/storage/data_folder.h"
#include "server/storage/storage_state.h"
#include "server/webhooks/webhooks.h"

namespace lumifold::server {

class AssetStore;
class FrameFinisher;

/// What all parts of a coordinator work with, apart from the state of the farm.
/// Threads: safe.
struct Resources {
  Resources(const CoordinatorOptions& the_options, const DataFolder& the_folder, ledger::JobStore* the_store,
            AssetStore* the_assets, FrameFinisher* the_finisher, ledger::Owner the_owner);

  const CoordinatorOptions options;
  const DataFolder folder;
  ledger::JobStore* const store;
  AssetStore* const assets;
  FrameFinisher* const finisher;
  /// This run of the coordinator, which owns all jobs in memory.
  const ledger::Owner owner;
  StorageState storage;
  monitoring::FarmTimings timings;
  Traffic traffic;
  /// Calls none, until the coordinator opens those of its options.
  std::unique_ptr<webhooks::Webhooks> webhooks;

  spdlog::logger& log() const { return *options.log; }
  ledger::OwnedJob Owned(const job::JobId& job) const { return {job, owner.epoch}; }
  /// Notes an error of the storage, and returns what the caller is told.
  absl::Status NoteError(const absl::Status& status);
  /// From now on lines about the job have its trace and its user.
  void LabelJob(const job::JobId& job, const v1::Scheduling& scheduling) const;
};

}  // namespace lumifold::server
