#include "tests/support/faulty_vfs.h"

#include <sqlite3.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <new>
#include <utility>

#include "filter/image/check.h"

namespace lumifold {
namespace {

constexpr char kName[] = "lumifold-faulty";

FaultyVfs* active = nullptr;
sqlite3_vfs* real = nullptr;
sqlite3_vfs shim = {};

/// Followed in memory by the real file.
struct ShimFile {
  sqlite3_file base;
  std::string* path;  // null for a temporary file
};

ShimFile* Shim(sqlite3_file* file) { return reinterpret_cast<ShimFile*>(file); }

sqlite3_file* Real(sqlite3_file* file) {
  return reinterpret_cast<sqlite3_file*>(reinterpret_cast<char*>(file) + sizeof(ShimFile));
}

/// The error of a call that fails, of which `code` is the one for an input or output error.
int ErrorOf(int code) {
  switch (active->fault()) {
    case FaultyVfs::Fault::kNoSpace:
      return code == SQLITE_IOERR_WRITE ? SQLITE_FULL : code;
    case FaultyVfs::Fault::kNoMemory:
      return code == SQLITE_CANTOPEN ? SQLITE_NOMEM : SQLITE_IOERR_NOMEM;
    default:
      return code;
  }
}

int Close(sqlite3_file* file) {
  const int code = Real(file)->pMethods->xClose(Real(file));
  delete Shim(file)->path;
  return code;
}

int Read(sqlite3_file* file, void* buffer, int size, sqlite3_int64 offset) {
  if (active->Fails(/*is_change=*/false)) return ErrorOf(SQLITE_IOERR_READ);
  return Real(file)->pMethods->xRead(Real(file), buffer, size, offset);
}

int Write(sqlite3_file* file, const void* buffer, int size, sqlite3_int64 offset) {
  const bool fails = active->Fails(/*is_change=*/true);
  // A write that fails has written a part.
  const int written = fails ? size / 2 : size;
  if (Shim(file)->path != nullptr) {
    active->OnWrite({.path = *Shim(file)->path,
                     .offset = offset,
                     .bytes = std::string(static_cast<const char*>(buffer), static_cast<size_t>(written))});
  }
  const int code =
      written == 0 ? SQLITE_OK : Real(file)->pMethods->xWrite(Real(file), buffer, written, offset);
  return fails ? ErrorOf(SQLITE_IOERR_WRITE) : code;
}

int Truncate(sqlite3_file* file, sqlite3_int64 size) {
  if (active->Fails(/*is_change=*/true)) return ErrorOf(SQLITE_IOERR_TRUNCATE);
  if (Shim(file)->path != nullptr)
    active->OnWrite({.path = *Shim(file)->path, .offset = size, .bytes = "", .is_truncation = true});
  return Real(file)->pMethods->xTruncate(Real(file), size);
}

int Sync(sqlite3_file* file, int) {
  if (active->Fails(/*is_change=*/true)) return ErrorOf(SQLITE_IOERR_FSYNC);
  // Durability is played, so the real file is not synced.
  if (Shim(file)->path != nullptr) active->OnSync(*Shim(file)->path);
  return SQLITE_OK;
}

int FileSize(sqlite3_file* file, sqlite3_int64* size) {
  if (active->Fails(/*is_change=*/false)) return ErrorOf(SQLITE_IOERR_FSTAT);
  return Real(file)->pMethods->xFileSize(Real(file), size);
}

int Lock(sqlite3_file* file, int level) { return Real(file)->pMethods->xLock(Real(file), level); }
int Unlock(sqlite3_file* file, int level) { return Real(file)->pMethods->xUnlock(Real(file), level); }
int CheckReservedLock(sqlite3_file* file, int* is_reserved) {
  return Real(file)->pMethods->xCheckReservedLock(Real(file), is_reserved);
}
int FileControl(sqlite3_file* file, int operation, void* argument) {
  return Real(file)->pMethods->xFileControl(Real(file), operation, argument);
}
int SectorSize(sqlite3_file* file) { return Real(file)->pMethods->xSectorSize(Real(file)); }
/// No promise about what survives a power cut.
int DeviceCharacteristics(sqlite3_file*) { return 0; }

int ShmMap(sqlite3_file* file, int page, int size, int extend, void volatile** map) {
  if (active->Fails(/*is_change=*/extend != 0)) return ErrorOf(SQLITE_IOERR_SHMMAP);
  return Real(file)->pMethods->xShmMap(Real(file), page, size, extend, map);
}
int ShmLock(sqlite3_file* file, int offset, int n, int flags) {
  return Real(file)->pMethods->xShmLock(Real(file), offset, n, flags);
}
void ShmBarrier(sqlite3_file* file) { Real(file)->pMethods->xShmBarrier(Real(file)); }
int ShmUnmap(sqlite3_file* file, int remove) { return Real(file)->pMethods->xShmUnmap(Real(file), remove); }

constexpr sqlite3_io_methods kMethods = {
    .iVersion = 2,  // with shared memory, without mapped pages, which would bypass Read and Write
    .xClose = Close,
    .xRead = Read,
    .xWrite = Write,
    .xTruncate = Truncate,
    .xSync = Sync,
    .xFileSize = FileSize,
    .xLock = Lock,
    .xUnlock = Unlock,
    .xCheckReservedLock = CheckReservedLock,
    .xFileControl = FileControl,
    .xSectorSize = SectorSize,
    .xDeviceCharacteristics = DeviceCharacteristics,
    .xShmMap = ShmMap,
    .xShmLock = ShmLock,
    .xShmBarrier = ShmBarrier,
    .xShmUnmap = ShmUnmap,
    .xFetch = nullptr,
    .xUnfetch = nullptr,
};

int Open(sqlite3_vfs*, sqlite3_filename name, sqlite3_file* file, int flags, int* flags_out) {
  file->pMethods = nullptr;
  Shim(file)->path = nullptr;
  if (active->Fails(/*is_change=*/false)) return ErrorOf(SQLITE_CANTOPEN);
  const int code = real->xOpen(real, name, Real(file), flags, flags_out);
  // A real file that could not be opened may still have to be closed.
  if (Real(file)->pMethods == nullptr) return code;
  file->pMethods = &kMethods;
  if (name != nullptr && code == SQLITE_OK) {
    Shim(file)->path = new std::string(name);
    active->OnOpen(name);
  }
  return code;
}

int Delete(sqlite3_vfs*, const char* name, int sync_folder) {
  if (active->Fails(/*is_change=*/true)) return ErrorOf(SQLITE_IOERR_DELETE);
  active->OnDelete(name);
  return real->xDelete(real, name, sync_folder);
}

std::string ContentOf(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

}  // namespace

FaultyVfs::FaultyVfs() {
  LUMIFOLD_CHECK(active == nullptr);
  real = sqlite3_vfs_find(nullptr);
  shim = *real;
  shim.zName = kName;
  shim.pNext = nullptr;
  shim.szOsFile = static_cast<int>(sizeof(ShimFile)) + real->szOsFile;
  shim.xOpen = Open;
  shim.xDelete = Delete;
  active = this;
  LUMIFOLD_CHECK(sqlite3_vfs_register(&shim, /*makeDflt=*/1) == SQLITE_OK);
}

FaultyVfs::~FaultyVfs() {
  sqlite3_vfs_unregister(&shim);
  sqlite3_vfs_register(real, /*makeDflt=*/1);
  active = nullptr;
}

void FaultyVfs::FailAt(int64_t call, Fault fault) {
  fault_ = fault;
  calls_left_ = call;
  has_failed_ = false;
}

bool FaultyVfs::Fails(bool is_change) {
  if (fault_ == Fault::kNone) return false;
  if (has_failed_) return fault_ == Fault::kPowerCut;
  const bool counts_changes_only = fault_ == Fault::kNoSpace || fault_ == Fault::kPowerCut;
  if (counts_changes_only && !is_change) return false;
  has_failed_ = --calls_left_ == 0;
  return has_failed_;
}

void FaultyVfs::OnOpen(const std::string& path) {
  if (!durable_.contains(path)) durable_[path] = ContentOf(path);
}

void FaultyVfs::Apply(const Write& write, size_t bytes, std::string* content) {
  const auto offset = static_cast<size_t>(write.offset);
  if (write.is_truncation) return content->resize(offset);
  if (content->size() < offset + bytes) content->resize(offset + bytes);
  content->replace(offset, bytes, write.bytes, 0, bytes);
}

void FaultyVfs::OnSync(const std::string& path) {
  for (const Write& write : unsynced_) {
    if (write.path == path) Apply(write, write.bytes.size(), &durable_[path]);
  }
  std::erase_if(unsynced_, [&path](const Write& write) { return write.path == path; });
}

void FaultyVfs::OnDelete(const std::string& path) {
  durable_.erase(path);
  std::erase_if(unsynced_, [&path](const Write& write) { return write.path == path; });
}

void FaultyVfs::Restore(Survivors survivors) {
  const size_t count = unsynced_.size();
  for (size_t i = 0; i < count; ++i) {
    const Write& write = unsynced_[i];
    size_t bytes = write.bytes.size();
    if (survivors == Survivors::kNone) break;
    if (survivors == Survivors::kFirstHalf && i >= count / 2) break;
    if (survivors == Survivors::kEveryOther && i % 2 == 0) continue;
    if (survivors == Survivors::kAllButHalfOfTheLast && i + 1 == count) bytes /= 2;
    Apply(write, bytes, &durable_[write.path]);
  }
  unsynced_.clear();
  for (const auto& [path, content] : durable_) {
    std::ofstream(path, std::ios::binary | std::ios::trunc) << content;
    std::filesystem::remove(path + "-shm");  // it never survives
  }
  fault_ = Fault::kNone;
  has_failed_ = false;
}

}  // namespace lumifold
