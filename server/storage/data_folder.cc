#include "server/storage/data_folder.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/statvfs.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <system_error>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "filter/image/file_calls.h"
#include "filter/image/file_io.h"

namespace lumifold::server {
namespace {

namespace fs = std::filesystem;

/// Everything in a folder and the folder itself, contents first.
absl::StatusOr<std::vector<std::string>> ContentsFirst(const std::string& path) {
  std::vector<std::string> all;
  std::error_code error;
  if (!fs::exists(fs::symlink_status(path, error))) return all;
  all.push_back(path);
  if (fs::is_directory(fs::symlink_status(path, error))) {
    for (fs::recursive_directory_iterator entry(path, error), end; !error && entry != end;
         entry.increment(error)) {
      all.push_back(entry->path().string());
    }
  }
  if (error) return absl::UnavailableError(absl::StrCat(path, ": ", error.message()));
  std::reverse(all.begin(), all.end());
  return all;
}

}  // namespace

absl::Status MakeFolder(const std::string& path, FileSystem* files) {
  std::error_code error;
  if (fs::is_directory(path, error)) return absl::OkStatus();
  const std::string parent = FolderOf(path);
  if (parent != path) {
    if (absl::Status status = MakeFolder(parent, files); !status.ok()) return status;
  }
  int failed = files->MakeFolder(path);
  if (failed == 0) failed = files->SyncFolder(parent);
  return failed == 0 ? absl::OkStatus() : StorageError(path, failed);
}

absl::Status RemoveAll(const std::string& path, FileSystem* files) {
  const absl::StatusOr<std::vector<std::string>> contents = ContentsFirst(path);
  if (!contents.ok()) return contents.status();
  for (const std::string& name : *contents) {
    const int error = files->Remove(name);
    if (error != 0 && error != -ENOENT) return StorageError(name, error);
  }
  return absl::OkStatus();
}

DataFolder DataFolder::WithLogsOf(const std::string& writer) const {
  DataFolder folder = *this;
  folder.writer_ = writer;
  return folder;
}

absl::Status DataFolder::MakeFolders() const {
  for (const char* folder : {"", "/assets", "/incoming", "/film", "/results", "/deleted"}) {
    if (absl::Status status = MakeFolder(root_ + folder, files_); !status.ok()) return status;
  }
  // A folder that someone made before may be open to others. Where it belongs to another user it stays so:
  // the files in it are private anyway.
  (void)chmod(root_.c_str(), 0700);
  return absl::OkStatus();
}

absl::StatusOr<rpc::FileHandle> DataFolder::Claim() const {
  if (absl::Status status = MakeFolders(); !status.ok()) return status;
  const std::string path = root_ + "/lock";
  rpc::FileHandle lock(open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600));
  if (lock.get() < 0) return StorageError(path, errno);
  if (flock(lock.get(), LOCK_EX | LOCK_NB) != 0) {
    return absl::FailedPreconditionError(
        absl::StrCat(root_, ": another coordinator is using this data folder"));
  }
  return lock;
}

bool DataFolder::IsBeingDeleted(const job::JobId& job) const {
  std::error_code error;
  return fs::exists(DeletionPath(job), error);
}

absl::StatusOr<uint64_t> DataFolder::FreeBytes() const {
  struct statvfs info = {};
  if (statvfs(root_.c_str(), &info) != 0) return StorageError(root_, errno);
  return uint64_t{info.f_bavail} * info.f_frsize;
}

std::string DataFolder::UnitLogName(const job::JobId& job, int32_t frame) const {
  return absl::StrFormat("film/%s/%s%04d%s%s%s", job.value(), kFramePrefix, frame, writer_.empty() ? "" : ".",
                         writer_, kLogSuffix);
}

std::string DataFolder::RoundsPath(const job::JobId& job, int32_t frame) const {
  return absl::StrFormat("%s/%s%04d.rounds", FilmPath(job), kFramePrefix, frame);
}

std::string DataFolder::ResultPath(const job::JobId& job, int32_t frame) const {
  return absl::StrFormat("%s/%s%04d%s", ResultsPath(job), kFramePrefix, frame, kResultSuffix);
}

std::string DataFolder::BlockPath(const job::JobId& job, int32_t frame, int block) const {
  return absl::StrCat(ResultPath(job, frame), ".block-", block, kPartialSuffix);
}

}  // namespace lumifold::server
