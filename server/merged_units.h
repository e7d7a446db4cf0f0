#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "server/data_folder.h"
#include "server/film/unit_log.h"
#include "server/film/unit_source.h"
#include "server/job/tile_grid.h"
#include "server/ledger/job_store.h"

namespace lumifold::server {

/// A frame's merged units: where the ledger says they are, in the data folder's logs. Threads: safe.
class MergedUnits final : public film::UnitSource {
 public:
  /// Errors: kDataLoss where the ledger names a unit that the frame does not have; those of the ledger and of
  /// opening a log.
  static absl::StatusOr<MergedUnits> Open(const DataFolder& folder, ledger::JobStore& store,
                                          const ledger::JobRecord& job, int32_t frame);

  /// Errors of both: kDataLoss for a unit that is not merged, or a record of another unit; those of
  /// UnitLogReader.
  absl::StatusOr<film::UnitOutline> Outline(const scheduler::UnitKey& key) const override;
  absl::StatusOr<EdgedImage> Read(const scheduler::UnitKey& key) const override;

 private:
  /// Where a unit's record is; of no length where the unit is not merged.
  struct Entry {
    size_t log = 0;
    film::RecordPlace place;
  };
  struct Log {
    std::string name;
    film::UnitLogReader reader;
  };

  MergedUnits(scheduler::JobId job, const v1::JobSpec& spec);
  absl::Status Add(const DataFolder& folder, const ledger::UnitRecord& record);
  absl::StatusOr<size_t> LogOf(const DataFolder& folder, const std::string& name);
  absl::StatusOr<Entry> Find(const scheduler::UnitKey& key) const;
  absl::Status CheckIsOf(const scheduler::UnitKey& key, const Entry& entry,
                         const scheduler::UnitRef& found) const;

  scheduler::JobId job_;
  scheduler::FrameUnits units_;
  std::vector<Log> logs_;
  std::vector<Entry> entries_;  // by number within the frame: frames have millions
};

}  // namespace lumifold::server
