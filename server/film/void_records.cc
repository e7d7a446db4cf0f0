#include "server/film/void_records.h"

#include <fcntl.h>

#include <string_view>

#include "filter/image/file_calls.h"
#include "proto/rpc/byte_stream.h"

namespace lumifold::film {
namespace {

/// In the place of a record's magic bytes.
constexpr std::string_view kVoid = "VOID";

}  // namespace

absl::Status VoidRecords(const std::string& path, absl::Span<const RecordPlace> places, FileSystem* files) {
  if (places.empty()) return absl::OkStatus();
  const rpc::FileHandle file(files->Open(path, O_WRONLY));
  if (file.get() < 0) return FileError(path, file.get());
  for (const RecordPlace& place : places) {
    if (const int written = files->Write(file.get(), place.offset, {kVoid}); written < 0)
      return FileError(path, written);
  }
  const int synced = files->Sync(file.get());
  return synced < 0 ? FileError(path, synced) : absl::OkStatus();
}

}  // namespace lumifold::film
