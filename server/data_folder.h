#pragma once

#include <cstdint>
#include <string>

#include "absl/status/statusor.h"
#include "proto/rpc/byte_stream.h"
#include "server/job/unit.h"

namespace lumifold::server {

/// Layout of a coordinator's data folder:
///
///   ledger.db        jobs and committed units
///   assets/SHA256    scenes and the files they refer to (SHA256.damaged: the disk has changed its content)
///   incoming/        uploads in progress, and what has arrived of those that broke (see AssetStore)
///   film/JOB/        unit logs, frame-NNNN.units
///   results/JOB/     results, frame-NNNN.exr, each with its SHA-256, frame-NNNN.exr.sha256
///   lock             lock file of the coordinator that uses the folder
///
/// Threads: safe.
class DataFolder {
 public:
  explicit DataFolder(std::string root) : root_(std::move(root)) {}

  /// Creates missing folders and takes the lock, which is held until the returned handle is closed.
  /// Errors: kFailedPrecondition where another coordinator holds it; kUnavailable with the system's message.
  /// Both name the folder.
  absl::StatusOr<rpc::FileHandle> Claim() const;

  /// Removes incomplete results of a coordinator that was killed.
  /// Errors: kUnavailable naming the file.
  absl::Status RemoveLeftovers() const;

  const std::string& root() const { return root_; }
  std::string LedgerPath() const { return root_ + "/ledger.db"; }
  std::string AssetsPath() const { return root_ + "/assets"; }
  std::string IncomingPath() const { return root_ + "/incoming"; }
  std::string FilmPath(const job::JobId& job) const { return root_ + "/film/" + job.value(); }
  std::string ResultsPath(const job::JobId& job) const { return root_ + "/results/" + job.value(); }

  /// Path of a frame's unit log relative to the data folder, as recorded in the ledger.
  static std::string UnitLogName(const job::JobId& job, int32_t frame);
  std::string PathOf(const std::string& name) const { return root_ + "/" + name; }
  std::string ResultPath(const job::JobId& job, int32_t frame) const;

 private:
  std::string root_;
};

/// Creates a folder and its missing parents.
/// Errors: kUnavailable naming it.
absl::Status MakeFolder(const std::string& path);

/// Removes a file, or a folder with its contents, if it exists.
/// Errors: kUnavailable naming it.
absl::Status RemoveAll(const std::string& path);

}  // namespace lumifold::server
