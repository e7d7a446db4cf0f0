#include "server/data_folder.h"

#include <fcntl.h>
#include <sys/file.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <system_error>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "filter/image/file_io.h"

namespace lumifold::server {

absl::Status MakeFolder(const std::string& path) {
  std::error_code error;
  std::filesystem::create_directories(path, error);
  if (error) return absl::UnavailableError(absl::StrCat(path, ": ", error.message()));
  return absl::OkStatus();
}

absl::Status RemoveAll(const std::string& path) {
  std::error_code error;
  std::filesystem::remove_all(path, error);
  if (error) return absl::UnavailableError(absl::StrCat(path, ": ", error.message()));
  return absl::OkStatus();
}

absl::StatusOr<rpc::FileHandle> DataFolder::Claim() const {
  for (const char* folder : {"", "/assets", "/incoming", "/film", "/results"}) {
    if (absl::Status status = MakeFolder(root_ + folder); !status.ok()) return status;
  }
  const std::string path = root_ + "/lock";
  rpc::FileHandle lock(open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644));
  if (lock.get() < 0) return absl::UnavailableError(absl::StrCat(path, ": ", std::strerror(errno)));
  if (flock(lock.get(), LOCK_EX | LOCK_NB) != 0) {
    return absl::FailedPreconditionError(
        absl::StrCat(root_, ": another coordinator is using this data folder"));
  }
  return lock;
}

absl::Status DataFolder::RemoveLeftovers() const {
  // Results that still have their temporary name are incomplete.
  std::vector<std::string> partial;
  std::error_code error;
  for (std::filesystem::recursive_directory_iterator entry(root_ + "/results", error), end;
       !error && entry != end; entry.increment(error)) {
    if (entry->path().extension() == kPartialSuffix) partial.push_back(entry->path().string());
  }
  if (error) return absl::UnavailableError(absl::StrCat(root_, "/results: ", error.message()));
  for (const std::string& path : partial) {
    if (absl::Status status = RemoveAll(path); !status.ok()) return status;
  }
  return absl::OkStatus();
}

std::string DataFolder::UnitLogName(const job::JobId& job, int32_t frame) {
  return absl::StrFormat("film/%s/frame-%04d.units", job.value(), frame);
}

std::string DataFolder::ResultPath(const job::JobId& job, int32_t frame) const {
  return absl::StrFormat("%s/frame-%04d.exr", ResultsPath(job), frame);
}

}  // namespace lumifold::server
