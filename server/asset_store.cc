#include "server/asset_store.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <utility>

#include "absl/strings/str_cat.h"

namespace lumifold::server {
namespace {

absl::Status SyncFolder(const std::string& folder) {
  const rpc::FileHandle handle(open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (handle.get() >= 0 && fsync(handle.get()) == 0) return absl::OkStatus();
  return absl::UnavailableError(absl::StrCat(folder, ": ", std::strerror(errno)));
}

}  // namespace

AssetUpload::AssetUpload(v1::AssetRef asset, std::string incoming_path, std::string final_path,
                         rpc::ByteReceiver receiver)
    : asset_(std::move(asset)),
      incoming_path_(std::move(incoming_path)),
      final_path_(std::move(final_path)),
      receiver_(std::move(receiver)) {}

AssetUpload::~AssetUpload() { unlink(incoming_path_.c_str()); }

absl::Status AssetUpload::Mismatch(const std::string& cause) const {
  return absl::DataLossError(absl::StrCat("asset '", asset_.uri(), "' (", asset_.sha256(), "): ", cause));
}

absl::Status AssetUpload::Add(const v1::ByteChunk& chunk) {
  if (chunk.total_size() != asset_.size()) {
    return Mismatch(absl::StrCat("its size is ", chunk.total_size(), ", announced were ", asset_.size()));
  }
  if (absl::Status status = receiver_.Add(chunk); !status.ok()) return status;
  sum_.Update(chunk.data());
  return absl::OkStatus();
}

absl::Status AssetUpload::Finish() {
  if (receiver_.offset() != asset_.size()) {
    return Mismatch(absl::StrCat("only ", receiver_.offset(), " of ", asset_.size(), " bytes arrived"));
  }
  if (sum_.FinishHex() != asset_.sha256()) return Mismatch("the SHA-256 of its content is different");
  if (absl::Status status = receiver_.Sync(); !status.ok()) return status;
  if (std::rename(incoming_path_.c_str(), final_path_.c_str()) != 0) {
    return absl::UnavailableError(absl::StrCat(final_path_, ": ", std::strerror(errno)));
  }
  return SyncFolder(final_path_.substr(0, final_path_.rfind('/')));
}

AssetStore::AssetStore(std::string folder, std::string incoming_folder)
    : folder_(std::move(folder)), incoming_folder_(std::move(incoming_folder)) {}

bool AssetStore::Has(const std::string& sha256) const {
  return rpc::IsSha256Hex(sha256) && access(PathOf(sha256).c_str(), R_OK) == 0;
}

absl::StatusOr<std::unique_ptr<AssetUpload>> AssetStore::Receive(const v1::AssetRef& asset) {
  if (!rpc::IsSha256Hex(asset.sha256())) {
    return absl::InvalidArgumentError(
        absl::StrCat("asset '", asset.uri(), "': sha256 is not 64 lower-case hexadecimal digits"));
  }
  // Two clients may send the same asset at the same time, so each upload has its own file until it is
  // complete.
  std::string incoming = absl::StrCat(incoming_folder_, "/", asset.sha256(), ".", uploads_.fetch_add(1));
  absl::StatusOr<rpc::ByteReceiver> receiver = rpc::ByteReceiver::Open(incoming, 0);
  if (!receiver.ok()) return receiver.status();
  return std::unique_ptr<AssetUpload>(
      new AssetUpload(asset, std::move(incoming), PathOf(asset.sha256()), *std::move(receiver)));
}

absl::StatusOr<rpc::ByteSender> AssetStore::Open(const std::string& sha256, uint64_t offset) const {
  if (!Has(sha256)) return absl::NotFoundError(absl::StrCat("no asset ", sha256));
  return rpc::ByteSender::Open(PathOf(sha256), offset);
}

}  // namespace lumifold::server
