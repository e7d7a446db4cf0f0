#pragma once

#include <cstdint>
#include <string>
#include <utility>

#include "absl/status/statusor.h"
#include "filter/image/file_system.h"
#include "proto/rpc/byte_stream.h"
#include "server/job/unit.h"

namespace lumifold::server {

/// Layout of a coordinator's data folder:
///
///   ledger.db        jobs and committed units
///   assets/SHA256    scenes and the files they refer to (SHA256.damaged: the disk has changed its content)
///   incoming/        uploads in progress, and what has arrived of those that broke (see AssetStore)
///   film/JOB/        the unit logs of a job, frame-NNNN.units, and its numeric class (class); until the job
///                    has ended, its manifest. Where several coordinators share the folder each has logs of
///                    its own, frame-NNNN.e12.units for epoch 12: one that was taken for dead and goes on
///                    writing harms nobody
///   results/JOB/     results, frame-NNNN.exr, each with its SHA-256, frame-NNNN.exr.sha256; the manifest of
///                    a job that has ended
///   deleted/JOB      empty: the job was deleted, its files go next (see Janitor)
///   access/          authority, server certificate, tokens (see access::AccessControl); there after `init`
///   webhook.secret   what calls of webhooks are signed with (see webhooks::ReadSecret)
///   reserve          space that is given up when the disk is full, so that the ledger can still be written
///   lock             lock file of the coordinator that uses the folder
///
/// Only its owner may read it: scenes are the users' property.
///
/// Threads: safe.
class DataFolder {
 public:
  static constexpr char kFramePrefix[] = "frame-";
  static constexpr char kLogSuffix[] = ".units";
  static constexpr char kResultSuffix[] = ".exr";

  /// All files but the ledger's are written through `files`, which must outlive the folder and its copies.
  explicit DataFolder(std::string root, FileSystem* files = PrivateFileSystem())
      : root_(std::move(root)), files_(files) {}

  /// The same folder, whose unit logs are those of a coordinator that shares it with others; empty: of the
  /// only one.
  DataFolder WithLogsOf(const std::string& writer) const;

  /// Creates missing folders and closes them to other users.
  /// Errors: kUnavailable with the system's message. It names the folder.
  absl::Status MakeFolders() const;
  /// MakeFolders, and takes the lock, which is held until the returned handle is closed.
  /// Errors: kFailedPrecondition where another coordinator holds it; kUnavailable with the system's message.
  /// Both name the folder.
  absl::StatusOr<rpc::FileHandle> Claim() const;

  const std::string& root() const { return root_; }
  FileSystem* files() const { return files_; }
  std::string LedgerPath() const { return root_ + "/ledger.db"; }
  std::string AccessPath() const { return root_ + "/access"; }
  std::string AssetsPath() const { return root_ + "/assets"; }
  std::string IncomingPath() const { return root_ + "/incoming"; }
  std::string FilmPath(const job::JobId& job) const { return root_ + "/film/" + job.value(); }
  std::string ResultsPath(const job::JobId& job) const { return root_ + "/results/" + job.value(); }
  std::string DeletionsPath() const { return root_ + "/deleted"; }
  std::string DeletionPath(const job::JobId& job) const { return DeletionsPath() + "/" + job.value(); }
  /// Whether the deletion of the job has begun: whatever is left of it goes.
  bool IsBeingDeleted(const job::JobId& job) const;

  std::string ReservePath() const { return root_ + "/reserve"; }
  /// The manifests of a job that has not ended, and of one that has.
  std::string ManifestPath(const job::JobId& job) const { return FilmPath(job) + "/manifest"; }
  std::string EndedManifestPath(const job::JobId& job) const { return ResultsPath(job) + "/manifest"; }
  std::string NumericClassPath(const job::JobId& job) const { return FilmPath(job) + "/class"; }

  /// Free space of the file system for this user.
  /// Errors: kUnavailable naming the folder.
  absl::StatusOr<uint64_t> FreeBytes() const;

  /// The frame's unit log that is written here, relative to the data folder.
  std::string UnitLogName(const job::JobId& job, int32_t frame) const;
  std::string PathOf(const std::string& name) const { return root_ + "/" + name; }
  std::string ResultPath(const job::JobId& job, int32_t frame) const;
  /// A block of the picture that a worker has filtered, until the result is made of it; the next start
  /// removes it.
  std::string BlockPath(const job::JobId& job, int32_t frame, int block) const;
  /// Record of the rounds of a frame with adaptive sampling.
  std::string RoundsPath(const job::JobId& job, int32_t frame) const;

 private:
  std::string root_;
  FileSystem* files_;
  std::string writer_;
};

/// Creates a folder and its missing parents. Durable once it returns OK.
/// Errors: kUnavailable naming it.
absl::Status MakeFolder(const std::string& path, FileSystem* files = PrivateFileSystem());

/// Removes a file, or a folder with its contents, if it exists.
/// Errors: kUnavailable naming it.
absl::Status RemoveAll(const std::string& path, FileSystem* files = PrivateFileSystem());

}  // namespace lumifold::server
