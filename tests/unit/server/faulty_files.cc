#include "tests/unit/server/faulty_files.h"

#include <fcntl.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <fstream>
#include <iterator>

namespace lumifold::server {
namespace {

namespace fs = std::filesystem;

std::string ContentOf(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

void SetContent(const std::string& path, const std::string& content) {
  std::ofstream(path, std::ios::binary | std::ios::trunc)
      .write(content.data(), static_cast<std::streamsize>(content.size()));
}

}  // namespace

void FaultyFiles::FailAt(int64_t call, int error) {
  absl::MutexLock lock(&mutex_);
  fail_at_ = call;
  fail_error_ = error;
}

void FaultyFiles::StopAt(int64_t call) {
  absl::MutexLock lock(&mutex_);
  stop_at_ = call;
}

void FaultyFiles::Fail(int error, const std::string& part) {
  absl::MutexLock lock(&mutex_);
  failing_ = error;
  failing_part_ = part;
}

void FaultyFiles::Break(const std::string& path) {
  struct stat info = {};
  absl::MutexLock lock(&mutex_);
  if (stat(path.c_str(), &info) == 0) broken_ = info.st_ino;
}

bool FaultyFiles::IsBroken(int file) const {
  struct stat info = {};
  absl::MutexLock lock(&mutex_);
  return broken_.has_value() && fstat(file, &info) == 0 && broken_ == info.st_ino;
}

bool FaultyFiles::has_stopped() const {
  absl::MutexLock lock(&mutex_);
  return stopped_;
}

int64_t FaultyFiles::calls() const {
  absl::MutexLock lock(&mutex_);
  return calls_;
}

void FaultyFiles::Restart(bool loses_unsynced) {
  absl::MutexLock lock(&mutex_);
  if (loses_unsynced) {
    for (const auto& [path, content] : contents_) {
      if (fs::exists(path)) SetContent(path, content);
    }
    std::reverse(names_.begin(), names_.end());
    for (const Durable& name : names_) {
      if (name.content.has_value()) {
        fs::create_directories(fs::path(name.path).parent_path());
        SetContent(name.path, *name.content);
      } else if (name.is_folder) {
        fs::create_directories(name.path);
      } else {
        fs::remove_all(name.path);
      }
    }
  }
  contents_.clear();
  names_.clear();
  stopped_ = stops_now_ = false;
  stop_at_ = fail_at_ = 0;
}

int FaultyFiles::Begin(const std::string& path) {
  on_call_(path);
  absl::MutexLock lock(&mutex_);
  ++calls_;
  stops_now_ = false;
  if (stopped_) return -EIO;
  if (calls_ == stop_at_) {
    stopped_ = stops_now_ = true;
    return -EIO;
  }
  if (calls_ == fail_at_) return -fail_error_;
  return failing_ != 0 && path.find(failing_part_) != std::string::npos ? -failing_ : 0;
}

std::string FaultyFiles::PathOf(int file) const {
  absl::MutexLock lock(&mutex_);
  const auto found = open_.find(file);
  return found == open_.end() ? "" : found->second;
}

void FaultyFiles::KeepContent(const std::string& path) {
  absl::MutexLock lock(&mutex_);
  if (!contents_.contains(path)) contents_[path] = ContentOf(path);
}

void FaultyFiles::KeepName(const std::string& path) {
  Durable name{.path = path, .content = std::nullopt, .is_folder = fs::is_directory(path)};
  absl::MutexLock lock(&mutex_);
  if (fs::is_regular_file(path)) {
    const auto durable = contents_.find(path);
    name.content = durable == contents_.end() ? ContentOf(path) : durable->second;
  }
  names_.push_back(std::move(name));
}

int FaultyFiles::Open(const std::string& path, int flags) {
  if (const int error = Begin(path); error != 0) return error;
  const bool creates = (flags & O_CREAT) != 0 && !fs::exists(path);
  if (creates) KeepName(path);
  const int file = real_->Open(path, flags);
  absl::MutexLock lock(&mutex_);
  if (file >= 0) open_[file] = path;
  return file;
}

void FaultyFiles::FailWrites(int count, const std::string& part) {
  absl::MutexLock lock(&mutex_);
  failing_writes_ = count;
  failing_writes_part_ = part;
}

int FaultyFiles::failing_writes() const {
  absl::MutexLock lock(&mutex_);
  return failing_writes_;
}

bool FaultyFiles::FailsThisWrite(const std::string& path) {
  absl::MutexLock lock(&mutex_);
  if (failing_writes_ == 0 || path.find(failing_writes_part_) == std::string::npos) return false;
  --failing_writes_;
  return true;
}

int FaultyFiles::Write(int file, uint64_t offset, absl::Span<const std::string_view> pieces) {
  const std::string path = PathOf(file);
  if (IsBroken(file) || FailsThisWrite(path)) return -EIO;
  const int error = Begin(path);
  bool tears = false;
  {
    absl::MutexLock lock(&mutex_);
    tears = stops_now_;
  }
  if (error != 0 && !tears && error != -ENOSPC) return error;
  KeepContent(path);
  if (error == 0) return real_->Write(file, offset, pieces);
  // A torn write, and one that finds the disk full, are half done.
  std::string half;
  for (const std::string_view piece : pieces) half += piece;
  half.resize(half.size() / 2);
  real_->Write(file, offset, {half});
  return error;
}

int FaultyFiles::Truncate(int file, uint64_t size) {
  const std::string path = PathOf(file);
  if (const int error = Begin(path); error != 0) return error;
  KeepContent(path);
  return real_->Truncate(file, size);
}

int FaultyFiles::Allocate(int file, uint64_t size) {
  const std::string path = PathOf(file);
  if (const int error = Begin(path); error != 0) return error;
  KeepContent(path);
  return real_->Allocate(file, size);
}

int FaultyFiles::Sync(int file) {
  if (IsBroken(file)) return -EIO;
  const std::string path = PathOf(file);
  if (const int error = Begin(path); error != 0) return error;
  absl::MutexLock lock(&mutex_);
  contents_.erase(path);
  return 0;
}

int FaultyFiles::SyncFolder(const std::string& folder) {
  if (const int error = Begin(folder); error != 0) return error;
  absl::MutexLock lock(&mutex_);
  std::erase_if(names_, [&](const Durable& name) { return FolderOf(name.path) == folder; });
  return 0;
}

int FaultyFiles::Rename(const std::string& from, const std::string& to) {
  if (const int error = Begin(from); error != 0) return error;
  KeepName(from);
  KeepName(to);
  return real_->Rename(from, to);
}

int FaultyFiles::Remove(const std::string& path) {
  if (const int error = Begin(path); error != 0) return error;
  KeepName(path);
  return real_->Remove(path);
}

int FaultyFiles::MakeFolder(const std::string& path) {
  if (const int error = Begin(path); error != 0) return error;
  if (!fs::exists(path)) KeepName(path);
  return real_->MakeFolder(path);
}

}  // namespace lumifold::server
