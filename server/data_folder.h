#pragma once

#include <cstdint>
#include <string>

#include "absl/status/statusor.h"
#include "proto/rpc/byte_stream.h"
#include "server/job/unit.h"

namespace lumifold::server {

/// Where a coordinator keeps everything:
///
///   ledger.db        which jobs there are and which units are merged
///   assets/SHA256    scenes and what they refer to; incoming/ holds those on their way
///   film/JOB/        unit logs, frame-NNNN.units
///   results/JOB/     finished pictures, frame-NNNN.exr
///   lock             held by the one coordinator that owns the folder
///
/// Threads: safe.
class DataFolder {
 public:
  explicit DataFolder(std::string root) : root_(std::move(root)) {}

  /// Makes what is missing and takes the lock, which lasts as long as the handle that comes back.
  /// Errors: kFailedPrecondition where another coordinator owns it; kUnavailable with the system's words.
  /// Both name the folder.
  absl::StatusOr<rpc::FileHandle> Claim() const;

  /// Removes what a coordinator that was killed left half done. Errors: kUnavailable naming the file.
  absl::Status RemoveLeftovers() const;

  const std::string& root() const { return root_; }
  std::string LedgerPath() const { return root_ + "/ledger.db"; }
  std::string AssetsPath() const { return root_ + "/assets"; }
  std::string IncomingPath() const { return root_ + "/incoming"; }
  std::string FilmPath(const scheduler::JobId& job) const { return root_ + "/film/" + job.value(); }
  std::string ResultsPath(const scheduler::JobId& job) const { return root_ + "/results/" + job.value(); }

  /// A unit log's name as the ledger holds it, within the folder.
  static std::string UnitLogName(const scheduler::JobId& job, int32_t frame);
  std::string PathOf(const std::string& name) const { return root_ + "/" + name; }
  std::string ResultPath(const scheduler::JobId& job, int32_t frame) const;

 private:
  std::string root_;
};

/// Makes a folder and those above it. Errors: kUnavailable naming it.
absl::Status MakeFolder(const std::string& path);

/// Removes a file, or a folder and all in it; nothing there is fine. Errors: kUnavailable naming it.
absl::Status RemoveAll(const std::string& path);

}  // namespace lumifold::server
