#pragma once

#include <optional>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/coordinator/cleanup.h"
#include "server/coordinator/loaded_job.h"
#include "server/coordinator/prerequisites.h"
#include "server/coordinator/resources.h"

namespace lumifold::server {

/// Reads what the ledger and the data folder have of unfinished jobs, and makes the two agree.
/// Threads: safe, for different jobs. It never holds the farm's lock.
class JobLoader {
 public:
  /// All must outlive it.
  JobLoader(const Resources* resources, FarmState* state, Cleanup* cleanup)
      : resources_(resources), cleanup_(cleanup), prerequisites_(resources, state) {}

  const Prerequisites& prerequisites() const { return prerequisites_; }
  /// Errors: those of the storage. What is wrong with the job alone is in LoadedJob::error.
  absl::StatusOr<LoadedJob> Load(const ledger::JobRecord& record);
  /// As its row in the ledger is now. nullopt: it has ended, and what is left of it is cleared away.
  absl::StatusOr<std::optional<LoadedJob>> Load(const job::JobId& job);
  /// Jobs whose manifest lies here but that the ledger does not have: they are entered into it. Clears away
  /// after jobs that have ended.
  absl::StatusOr<std::vector<ledger::JobRecord>> FindForgottenJobs();

 private:
  absl::Status LoadProgress(LoadedJob* loaded);
  absl::Status LoadRounds(LoadedJob* loaded) const;
  absl::Status RestoreFiles(const ledger::JobRecord& record, const std::vector<int32_t>& finished);

  const Resources* const resources_;
  Cleanup* const cleanup_;
  const Prerequisites prerequisites_;
};

}  // namespace lumifold::server
