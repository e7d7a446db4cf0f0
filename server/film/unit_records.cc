#include "server/film/unit_records.h"

#include <utility>

#include "absl/strings/str_cat.h"

namespace lumifold::film {

absl::StatusOr<UnitRecords> UnitRecords::Open(UnitLogReader records) {
  UnitRecords units(std::move(records));
  absl::Status status = units.records_.ForEachHeader(
      [&](const UnitHeader& header, const RecordPlace& place) { units.places_[header.unit.key] = place; });
  if (!status.ok()) return status;
  return units;
}

absl::StatusOr<RecordPlace> UnitRecords::Find(const job::UnitKey& key) const {
  const auto found = places_.find(key);
  if (found == places_.end())
    return absl::DataLossError(absl::StrCat("a unit of tile ", key.tile, " is missing"));
  return found->second;
}

absl::StatusOr<UnitOutline> UnitRecords::Outline(const job::UnitKey& key) const {
  const absl::StatusOr<RecordPlace> place = Find(key);
  if (!place.ok()) return place.status();
  absl::StatusOr<UnitHeader> header = records_.ReadHeader(*place);
  if (!header.ok()) return header.status();
  return std::move(header->outline);
}

absl::StatusOr<EdgedImage> UnitRecords::Read(const job::UnitKey& key) const {
  const absl::StatusOr<RecordPlace> place = Find(key);
  if (!place.ok()) return place.status();
  absl::StatusOr<StoredUnit> unit = records_.Read(*place);
  if (!unit.ok()) return unit.status();
  return std::move(unit->image);
}

}  // namespace lumifold::film
