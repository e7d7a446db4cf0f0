#pragma once

#include <cstdint>
#include <string>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "filter/image/edged_image.h"
#include "lumifold/v1/worker.pb.h"
#include "proto/rpc/byte_stream.h"
#include "server/film/unit_source.h"
#include "server/job/unit.h"

namespace lumifold::film {

/// A delivered unit: its id, the attempt of its lease, its statistics, its pixels and its edge set.
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
///   "LFU2"
///   u32  size of the header
///   u64  size of the payload
///   u64  XXH3-64 of the payload
///   u64  XXH3-64 of the 24 bytes before and the header
///   header: a v1::UnitChunk without data
///   payload: the planes of the pixels in the order of their v1::PixelLayout, then those of the edge set,
///            if there is one, in the order of its own layout
///
/// All numbers are little-endian. Records of another version ("LFU" and another digit) give an error that
/// says so.
///
/// Threads: one at a time.
class UnitLog {
 public:
  /// Opens the log at `path`, or creates it, for appending after its first `committed_bytes`, the bytes whose
  /// units have ledger rows. Bytes beyond them were never acknowledged and are truncated.
  /// Errors: kDataLoss where the file is shorter; kUnavailable with the system's message. Both name the file.
  static absl::StatusOr<UnitLog> Open(const std::string& path, uint64_t committed_bytes);

  /// Writes a record at the end; it is durable after the next Sync. After an error the next record overwrites
  /// it.
  absl::StatusOr<RecordPlace> Append(const StoredUnit& unit);

  /// Waits until all records are on the disk (fdatasync).
  absl::Status Sync();

 private:
  UnitLog(std::string path, rpc::FileHandle file, uint64_t end);

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

  /// Errors: kDataLoss naming file and offset where the record is incomplete or a checksum does not match;
  /// kFailedPrecondition where another version of Lumifold wrote it.
  absl::StatusOr<StoredUnit> Read(const RecordPlace& place) const;

  /// As Read, for the header only; the pixels are not checked.
  absl::StatusOr<UnitHeader> ReadHeader(const RecordPlace& place) const;

  /// Reads records from the beginning to the end of the file or to the first damaged record; returns the
  /// number of valid bytes.
  /// Errors: kFailedPrecondition as Read().
  absl::StatusOr<uint64_t> Scan(absl::FunctionRef<void(const StoredUnit&, const RecordPlace&)> visit) const;

 private:
  UnitLogReader(std::string path, rpc::FileHandle file, uint64_t size);
  absl::Status CheckWithinFile(const RecordPlace& place) const;
  absl::StatusOr<RecordPlace> PlaceAt(uint64_t offset) const;

  std::string path_;
  rpc::FileHandle file_;
  uint64_t size_;
};

}  // namespace lumifold::film
