#include "server/film/void_records.h"

#include <fcntl.h>

#include <cerrno>
#include <cstring>
#include <string_view>

#include "absl/strings/str_cat.h"
#include "proto/rpc/byte_stream.h"

namespace lumifold::film {
namespace {

/// In the place of a record's magic bytes.
constexpr std::string_view kVoid = "VOID";

absl::Status SystemError(const std::string& path, int result) {
  const std::string text = absl::StrCat(path, ": ", std::strerror(-result));
  return result == -ENOENT ? absl::NotFoundError(text) : absl::UnavailableError(text);
}

}  // namespace

absl::Status VoidRecords(const std::string& path, absl::Span<const RecordPlace> places, FileSystem* files) {
  if (places.empty()) return absl::OkStatus();
  const rpc::FileHandle file(files->Open(path, O_WRONLY));
  if (file.get() < 0) return SystemError(path, file.get());
  for (const RecordPlace& place : places) {
    if (const int written = files->Write(file.get(), place.offset, {kVoid}); written < 0)
      return SystemError(path, written);
  }
  const int synced = files->Sync(file.get());
  return synced < 0 ? SystemError(path, synced) : absl::OkStatus();
}

}  // namespace lumifold::film
