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

/// A delivered unit: its name, the lease it came by, what it says of itself, its pixels and its edge set.
struct StoredUnit {
  scheduler::UnitRef unit;
  scheduler::Attempt attempt;
  v1::UnitStats stats;
  EdgedImage image;
};

/// What the header of a record says.
struct UnitHeader {
  scheduler::UnitRef unit;
  UnitOutline outline;
};

/// Where a record lies in its log.
struct RecordPlace {
  uint64_t offset = 0;
  uint64_t length = 0;
};

/// The append-only file that holds a frame's delivered units. Each record describes itself and carries
/// checksums, so that a ledger that was lost can be made anew from the logs:
///
///   "LFU2"
///   u32  size of the header
///   u64  size of the payload
///   u64  XXH3-64 of the payload
///   u64  XXH3-64 of the 24 bytes before and the header
///   header: a v1::UnitChunk without data
///   payload: the planes of the pixels, as their v1::PixelLayout says, then those of the edge set, if one is
///            there, as its own says
///
/// All little-endian. Records of another version ("LFU" and another digit) are refused by name.
///
/// Threads: one at a time.
class UnitLog {
 public:
  /// Opens the log at `path`, made where it is missing, to go on after its first `committed_bytes`: those the
  /// ledger knows of. What lies beyond was never acknowledged and is cut off.
  /// Errors: kDataLoss where the file is shorter; kUnavailable with the system's words. Both name the file.
  static absl::StatusOr<UnitLog> Open(const std::string& path, uint64_t committed_bytes);

  /// Writes a record at the end; it is durable after the next Sync. After an error the next record takes its
  /// place.
  absl::StatusOr<RecordPlace> Append(const StoredUnit& unit);

  /// Brings all records to the disk.
  absl::Status Sync();

 private:
  UnitLog(std::string path, rpc::FileHandle file, uint64_t end);

  std::string path_;
  rpc::FileHandle file_;
  uint64_t end_;
};

/// Reads records of a log. Threads: safe.
class UnitLogReader {
 public:
  /// Errors: kNotFound, kUnavailable naming the file.
  static absl::StatusOr<UnitLogReader> Open(const std::string& path);

  /// Errors: kDataLoss naming file and offset where the record is not whole or not what its checksums say;
  /// kFailedPrecondition where it was written by a Lumifold of another version.
  absl::StatusOr<StoredUnit> Read(const RecordPlace& place) const;

  /// The same for the header alone: the pixels may be damaged.
  absl::StatusOr<UnitHeader> ReadHeader(const RecordPlace& place) const;

  /// Reads records from the beginning until the end of the file or the first that is not whole; gives the
  /// bytes that are good. Errors: kFailedPrecondition as Read().
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
