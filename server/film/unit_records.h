#pragma once

#include <map>

#include "absl/status/statusor.h"
#include "server/film/unit_log.h"
#include "server/film/unit_source.h"
#include "server/job/unit.h"

namespace lumifold::film {

/// The units of a frame in a file that has their records one after another, and nothing else.
/// Threads: safe.
class UnitRecords final : public UnitSource {
 public:
  /// Errors: those of UnitLogReader::ForEachHeader.
  static absl::StatusOr<UnitRecords> Open(UnitLogReader records);

  /// Errors of both: kDataLoss for a unit that is not here; those of UnitLogReader.
  absl::StatusOr<UnitOutline> Outline(const job::UnitKey& key) const override;
  absl::StatusOr<EdgedImage> Read(const job::UnitKey& key) const override;

 private:
  explicit UnitRecords(UnitLogReader records) : records_(std::move(records)) {}
  absl::StatusOr<RecordPlace> Find(const job::UnitKey& key) const;

  UnitLogReader records_;
  std::map<job::UnitKey, RecordPlace> places_;
};

}  // namespace lumifold::film
