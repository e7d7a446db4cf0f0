#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/types/span.h"
#include "server/film/unit_log.h"
#include "server/film/unit_source.h"
#include "server/job/tile_grid.h"
#include "server/ledger/job_store.h"
#include "server/storage/data_folder.h"

namespace lumifold::server {

/// The committed units of a frame: the ledger's records and the data folder's unit logs.
/// Threads: safe.
class CommittedUnits final : public film::UnitSource {
 public:
  /// Errors: kDataLoss where the ledger names a unit that the frame does not have; those of the ledger and of
  /// opening a log.
  static absl::StatusOr<CommittedUnits> Open(const DataFolder& folder, ledger::JobStore& store,
                                             const ledger::JobRecord& job, int32_t frame);

  bool Has(const job::UnitKey& key) const { return entries_[NumberOf(key)].place.length > 0; }
  /// From now on the units of other tiles count as not committed.
  void KeepTiles(const std::vector<int32_t>& tiles);
  /// And those of passes after this one.
  void KeepPasses(int32_t last);
  /// Of the frame's units.
  int64_t count() const;
  /// Bytes of all their records.
  uint64_t record_bytes() const;
  /// Differs where other records were committed, as after units were taken back. Of this process only.
  size_t Fingerprint() const;
  /// Units of the frame, committed or not.
  int64_t places() const { return static_cast<int64_t>(entries_.size()); }
  /// Bytes of the record of the unit with this number; 0 if it is not committed.
  uint64_t record_bytes(int64_t number) const { return entries_[static_cast<size_t>(number)].place.length; }
  /// Fills `bytes` with those of that record from the one with number `first` on, as they lie in the log.
  /// Errors: those of UnitLogReader::ReadBytes.
  absl::Status ReadRecord(int64_t number, uint64_t first, absl::Span<char> bytes) const;

  /// Errors of both: kDataLoss for a unit that is not committed, or for a record of another unit; those of
  /// UnitLogReader.
  absl::StatusOr<film::UnitOutline> Outline(const job::UnitKey& key) const override;
  absl::StatusOr<EdgedImage> Read(const job::UnitKey& key) const override;

 private:
  /// Position of a unit's record; length 0 where the unit is not committed.
  struct Entry {
    size_t log = 0;
    film::RecordPlace place;
  };
  struct Log {
    std::string name;
    film::UnitLogReader reader;
  };

  CommittedUnits(job::JobId job, const v1::JobSpec& spec);
  absl::Status Add(const DataFolder& folder, const ledger::UnitRecord& record);
  absl::StatusOr<size_t> LogOf(const DataFolder& folder, const std::string& name);
  size_t NumberOf(const job::UnitKey& key) const { return static_cast<size_t>(*units_.NumberOf(key)); }
  absl::StatusOr<Entry> Find(const job::UnitKey& key) const;
  absl::Status CheckIsOf(const job::UnitKey& key, const Entry& entry, const job::UnitRef& found) const;

  job::JobId job_;
  job::FrameUnits units_;
  std::vector<Log> logs_;
  std::vector<Entry> entries_;  // by unit number: a frame may have millions of units
};

}  // namespace lumifold::server
