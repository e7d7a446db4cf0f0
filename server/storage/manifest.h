#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "lumifold/v1/manifest.pb.h"
#include "server/ledger/job_store.h"
#include "server/storage/data_folder.h"

namespace lumifold::server {

// A job's manifest lies beside its film until the job has ended, then beside its results. Its numeric class
// is a file of its own, because it is not known before the first unit is committed.

v1::JobManifest ManifestOf(const ledger::NewJob& job);
ledger::NewJob JobOf(const v1::JobManifest& manifest, const ledger::Owner& owner);

/// Writes the manifest of a job that has not ended, and makes the folder of its film.
/// Errors: kUnavailable naming the file. Durable once it returns OK.
absl::Status WriteManifest(const DataFolder& folder, const v1::JobManifest& manifest);

/// Replaces the scheduling, or the spec, in the manifest of a job that has not ended.
/// Errors: as ReadManifest and WriteManifest.
absl::Status RewriteManifest(const DataFolder& folder, const job::JobId& job,
                             const v1::Scheduling& scheduling);
absl::Status RewriteManifest(const DataFolder& folder, const job::JobId& job, const v1::JobSpec& spec);

/// Moves the manifest of a job that has ended beside its results, with its end. Can be repeated; no effect on
/// a job whose manifest is there.
/// Errors: kUnavailable naming the file.
absl::Status RetireJob(const DataFolder& folder, const job::JobId& job, v1::JobState end_state,
                       const std::string& error);

/// Moves the manifest of a job that has ended back to its film: the job runs again. Can be repeated. `record`
/// is its row, with spec and scheduling as they are from now on.
/// Errors: kUnavailable naming the file.
absl::Status UnretireJob(const DataFolder& folder, const ledger::JobRecord& record);

/// Reads a manifest.
/// Errors: kNotFound; kDataLoss where it is damaged; kUnavailable. All name the file.
absl::StatusOr<v1::JobManifest> ReadManifest(const std::string& path);

/// Records the numeric class of a job's units. Durable once it returns OK.
/// Errors: kUnavailable naming the file.
absl::Status WriteNumericClass(const DataFolder& folder, const job::JobId& job,
                               const std::string& numeric_class);
/// The recorded class; empty if there is none.
std::string ReadNumericClass(const DataFolder& folder, const job::JobId& job);

}  // namespace lumifold::server
