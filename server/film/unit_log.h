#pragma once

#include <cstdint>
#include <string>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/types/span.h"
#include "filter/image/edged_image.h"
#include "filter/image/file_system.h"
#include "lumifold/v1/worker.pb.h"
#include "proto/rpc/byte_stream.h"
#include "server/film/unit_record.h"
#include "server/film/unit_source.h"
#include "server/job/unit.h"

namespace lumifold::film {

/// A unit that was read: its id, the attempt of its lease, its statistics, its pixels and its list.
struct StoredUnit {
  job::UnitRef unit;
  job::Attempt attempt;
  v1::UnitStats stats;
  EdgedImage image;
};

/// Contents of a record's header.
struct UnitHeader {
  job::UnitRef unit;
  UnitOutline outline;
};

/// Position of a record in its log.
struct RecordPlace {
  uint64_t offset = 0;
  uint64_t length = 0;
};

/// The append-only file of a frame's delivered units. Each record describes itself and has checksums, so that
/// a lost ledger can be rebuilt from the logs:
///
///   "LFU8"
///   u32  size of the header
///   u64  size of the payload
///   u64  XXH3-64 of the payload
///   u64  XXH3-64 of all values, see DeliveredPixels::values_checksum
///   u64  XXH3-64 of the 32 bytes before and the header
///   header: a v1::UnitChunk without data (unit_record.h encodes it)
///   payload: the encoded planes of the pixels in the order of their v1::PixelLayout, then those of the edge
///            set or of the fragments, if there are any, in the order of their own layout
///
/// All numbers are little-endian. Records of another version ("LFU" and another digit) give an error that
/// says so.
///
/// Threads: one at a time.
class UnitLog {
 public:
  /// Opens the log at `path`, or creates it, for appending after its first `committed_bytes`, the bytes whose
  /// units have ledger rows. Bytes beyond them are truncated: whoever opens a log of an earlier run first
  /// scans it for records that the ledger does not know. `files` must outlive the log.
  /// Errors: kDataLoss where the file is shorter; kUnavailable with the system's message. Both name the file.
  static absl::StatusOr<UnitLog> Open(const std::string& path, uint64_t committed_bytes,
                                      FileSystem* files = PrivateFileSystem());

  /// Writes a record at the end; it is durable after the next Sync. After an error the next record overwrites
  /// it. After an error of Sync nothing that was written since the last one may be believed: open the log
  /// again.
  /// Errors of both: kDataLoss where the disk cannot write this file (EIO); kUnavailable with the system's
  /// message.
  absl::StatusOr<RecordPlace> Append(const EncodedUnit& unit);

  /// Waits until all records are on the disk (fdatasync).
  absl::Status Sync();

 private:
  UnitLog(std::string path, rpc::FileHandle file, uint64_t end, FileSystem* files);

  FileSystem* files_;
  std::string path_;
  rpc::FileHandle file_;
  uint64_t end_;
};

/// Reads records of a log.
/// Threads: safe.
class UnitLogReader {
 public:
  /// Errors: kNotFound, kUnavailable naming the file.
  static absl::StatusOr<UnitLogReader> Open(const std::string& path);
  /// The same for a file that is open; `path` is for messages.
  static absl::StatusOr<UnitLogReader> OfFile(rpc::FileHandle file, const std::string& path);

  /// Errors: kDataLoss naming file and offset where the record is incomplete or a checksum does not match;
  /// kFailedPrecondition where another version of Lumifold wrote it.
  absl::StatusOr<StoredUnit> Read(const RecordPlace& place) const;

  /// As Read, for the header only; the pixels are not checked.
  absl::StatusOr<UnitHeader> ReadHeader(const RecordPlace& place) const;

  /// Fills `bytes` with those of the record from the one with number `first` on, as they are, neither checked
  /// nor decoded. Errors: kDataLoss where they are not within the record or the file; as Read.
  absl::Status ReadBytes(const RecordPlace& place, uint64_t first, absl::Span<char> bytes) const;

  /// Reads the headers of all records, of a file that has nothing else. Errors: as Read.
  absl::Status ForEachHeader(absl::FunctionRef<void(const UnitHeader&, const RecordPlace&)> visit) const;

  /// EncodedUnit::digest of the record. Errors: as Read; the pixels are not checked.
  absl::StatusOr<std::string> ReadDigest(const RecordPlace& place) const;

  /// Reads the records from `first` to the end of the file. Where one is damaged, it goes on with the next
  /// offset at which an undamaged record begins. Returns the end of the last undamaged record, or `first`:
  /// what follows is the torn tail of a write that never ended.
  /// Errors: kFailedPrecondition as Read(); kUnavailable with the system's message.
  absl::StatusOr<uint64_t> Scan(uint64_t first,
                                absl::FunctionRef<void(const StoredUnit&, const RecordPlace&)> visit) const;

 private:
  UnitLogReader(std::string path, rpc::FileHandle file, uint64_t size);
  absl::Status CheckWithinFile(const RecordPlace& place) const;
  absl::StatusOr<RecordPlace> PlaceAt(uint64_t offset) const;
  /// The record at `offset` if it is undamaged. Errors: kDataLoss otherwise, and as Read().
  absl::StatusOr<StoredUnit> ReadRecordAt(uint64_t offset, RecordPlace* place) const;
  /// The first offset from `offset` on that has the first bytes of a record; the size of the file if there is
  /// none.
  absl::StatusOr<uint64_t> FindMagic(uint64_t offset) const;

  std::string path_;
  rpc::FileHandle file_;
  uint64_t size_;
};

}  // namespace lumifold::film
