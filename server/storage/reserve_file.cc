#include "server/storage/reserve_file.h"

#include <fcntl.h>

#include <cstring>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/rpc/byte_stream.h"

namespace lumifold::server {

ReserveFile::ReserveFile(std::string path, uint64_t bytes, FileSystem* files)
    : path_(std::move(path)), bytes_(bytes), files_(files) {}

absl::Status ReserveFile::Take() {
  if (held_) return absl::OkStatus();
  const int opened = files_->Open(path_, O_RDWR | O_CREAT);
  const rpc::FileHandle file(opened);
  int error = opened < 0 ? opened : 0;
  if (error == 0) error = bytes_ == 0 ? files_->Truncate(opened, 0) : files_->Allocate(opened, bytes_);
  if (error == 0) error = files_->Sync(opened);
  if (error == 0) error = files_->SyncFolder(FolderOf(path_));
  if (error != 0) {
    return absl::UnavailableError(
        absl::StrCat(path_, ": cannot reserve ", bytes_ >> 20, " MiB: ", std::strerror(-error)));
  }
  held_ = true;
  return absl::OkStatus();
}

void ReserveFile::GiveUp() {
  held_ = false;
  const int opened = files_->Open(path_, O_RDWR);
  if (opened < 0) return;
  const rpc::FileHandle file(opened);
  files_->Truncate(opened, 0);
}

}  // namespace lumifold::server
