#pragma once

#include <cstdint>
#include <functional>
#include <memory>

#include "absl/time/time.h"
#include "server/coordinator/finish_options.h"
#include "server/storage/retention.h"
#include "server/storage/storage_options.h"
#include "server/webhooks/webhooks.h"

namespace spdlog {
class logger;
}  // namespace spdlog

namespace lumifold::logging {
class JobLabels;
}  // namespace lumifold::logging

namespace lumifold::server {

class AssetChecks;
class EventLog;

/// What users may take of a coordinator. Those of one job are in server/job/limits.h.
struct JobLimits {
  /// Active jobs of one user.
  int jobs_per_user = 2000;
  /// All files of a job's scene.
  uint64_t job_asset_bytes = 256'000'000'000;
};

/// What a coordinator tells its program, from any thread.
struct Notifications {
  /// Called with false when the storage can no longer be written, and with true when it can again.
  std::function<void(bool)> on_storage_change = [](bool) {};
  /// Called once, when its jobs belong to others: nothing that it does counts any more.
  std::function<void()> on_expelled = [] {};
};

/// What lines of the log say of jobs, and where they can be read.
struct JobLog {
  /// Null: lines say nothing of them.
  std::shared_ptr<logging::JobLabels> labels = nullptr;
  /// What GetLog reads; must outlive the coordinator.
  EventLog* events = nullptr;
};

/// What is expected of workers.
struct WorkerTerms {
  absl::Duration lease = absl::Seconds(30);
  /// Interval of their heartbeats.
  absl::Duration heartbeat = absl::Seconds(5);
  /// There is one, and there will be no other: a job fails when it says so, see scheduler::Disputes.
  bool only_one = false;
};

/// What a Coordinator is made with.
struct CoordinatorOptions {
  WorkerTerms workers;
  FinishOptions finishing;
  /// Monotonic clock: orders everything.
  std::function<absl::Time()> now;
  /// Wall clock: stamps submissions, for display and for the ids of jobs.
  std::function<absl::Time()> wall_now;
  std::function<uint64_t()> random;
  std::shared_ptr<spdlog::logger> log;
  StorageOptions storage;
  JobLimits limits;
  /// What is kept of jobs that have ended. The free bytes of the disk are set by the coordinator.
  RetentionLimits retention;
  /// Calls when jobs have ended.
  webhooks::WebhookOptions webhooks;
  Notifications notify;
  JobLog job_log;
  /// Reads assets again that workers could not get; must be stopped before the coordinator ends.
  AssetChecks* asset_checks = nullptr;
  /// Whether connections are in plain text, for display.
  bool insecure = false;
  /// Whether others may have the same ledger and data folder: then the unfinished jobs are not claimed, but
  /// adopted as cluster::Membership says.
  bool is_member = false;
};

}  // namespace lumifold::server
