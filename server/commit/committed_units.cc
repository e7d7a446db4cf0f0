#include "server/commit/committed_units.h"

#include <algorithm>
#include <optional>
#include <set>
#include <utility>

#include "absl/hash/hash.h"
#include "absl/strings/str_cat.h"

namespace lumifold::server {

using job::UnitKey;
using job::UnitRef;

CommittedUnits::CommittedUnits(job::JobId job, const v1::JobSpec& spec)
    : job_(std::move(job)), units_(spec), entries_(static_cast<size_t>(units_.count())) {}

absl::StatusOr<CommittedUnits> CommittedUnits::Open(const DataFolder& folder, ledger::JobStore& store,
                                                    const ledger::JobRecord& job, int32_t frame) {
  CommittedUnits units(job.id, job.spec);
  absl::Status added;
  absl::Status read = store.ForEachUnit(job.id, frame, [&](const ledger::UnitRecord& record) {
    if (added.ok()) added = units.Add(folder, record);
  });
  if (!read.ok()) return read;
  if (!added.ok()) return added;
  return units;
}

absl::Status CommittedUnits::Add(const DataFolder& folder, const ledger::UnitRecord& record) {
  const std::optional<int64_t> number = units_.NumberOf(record.unit.key);
  if (!number.has_value())
    return absl::DataLossError(absl::StrCat("ledger: the job has no unit ", Describe(record.unit)));
  const absl::StatusOr<size_t> log = LogOf(folder, record.file);
  if (!log.ok()) return log.status();
  entries_[static_cast<size_t>(*number)] = {*log, {record.offset, record.length}};
  return absl::OkStatus();
}

absl::StatusOr<size_t> CommittedUnits::LogOf(const DataFolder& folder, const std::string& name) {
  for (size_t i = 0; i < logs_.size(); ++i) {
    if (logs_[i].name == name) return i;
  }
  absl::StatusOr<film::UnitLogReader> reader = film::UnitLogReader::Open(folder.PathOf(name));
  if (!reader.ok()) return reader.status();
  logs_.push_back({name, *std::move(reader)});
  return logs_.size() - 1;
}

void CommittedUnits::KeepTiles(const std::vector<int32_t>& tiles) {
  const std::set<int32_t> kept(tiles.begin(), tiles.end());
  for (size_t number = 0; number < entries_.size(); ++number) {
    if (!kept.contains(units_.KeyOf(0, static_cast<int64_t>(number)).tile)) entries_[number] = {};
  }
}

void CommittedUnits::KeepPasses(int32_t last) {
  for (size_t number = 0; number < entries_.size(); ++number) {
    if (units_.KeyOf(0, static_cast<int64_t>(number)).pass > last) entries_[number] = {};
  }
}

int64_t CommittedUnits::count() const {
  return std::count_if(entries_.begin(), entries_.end(),
                       [](const Entry& entry) { return entry.place.length > 0; });
}

uint64_t CommittedUnits::record_bytes() const {
  uint64_t bytes = 0;
  for (const Entry& entry : entries_) bytes += entry.place.length;
  return bytes;
}

size_t CommittedUnits::Fingerprint() const {
  size_t hash = 0;
  for (const Log& log : logs_) hash = absl::HashOf(hash, log.name);
  for (const Entry& entry : entries_)
    hash = absl::HashOf(hash, entry.log, entry.place.offset, entry.place.length);
  return hash;
}

absl::Status CommittedUnits::ReadRecord(int64_t number, uint64_t first, absl::Span<char> bytes) const {
  const Entry& entry = entries_[static_cast<size_t>(number)];
  return logs_[entry.log].reader.ReadBytes(entry.place, first, bytes);
}

absl::StatusOr<CommittedUnits::Entry> CommittedUnits::Find(const UnitKey& key) const {
  const Entry& entry = entries_[NumberOf(key)];
  if (entry.place.length == 0)
    return absl::DataLossError(absl::StrCat("ledger: tile ", key.tile, " has units that are not committed"));
  return entry;
}

absl::Status CommittedUnits::CheckIsOf(const UnitKey& key, const Entry& entry, const UnitRef& found) const {
  const UnitRef wanted = {job_, key};
  if (found == wanted) return absl::OkStatus();
  return absl::DataLossError(absl::StrCat(logs_[entry.log].name, ": record at ", entry.place.offset,
                                          " is of ", Describe(found), ", not of ", Describe(wanted)));
}

absl::StatusOr<film::UnitOutline> CommittedUnits::Outline(const UnitKey& key) const {
  const absl::StatusOr<Entry> entry = Find(key);
  if (!entry.ok()) return entry.status();
  absl::StatusOr<film::UnitHeader> header = logs_[entry->log].reader.ReadHeader(entry->place);
  if (!header.ok()) return header.status();
  if (absl::Status status = CheckIsOf(key, *entry, header->unit); !status.ok()) return status;
  return std::move(header->outline);
}

absl::StatusOr<EdgedImage> CommittedUnits::Read(const UnitKey& key) const {
  const absl::StatusOr<Entry> entry = Find(key);
  if (!entry.ok()) return entry.status();
  absl::StatusOr<film::StoredUnit> stored = logs_[entry->log].reader.Read(entry->place);
  if (!stored.ok()) return stored.status();
  if (absl::Status status = CheckIsOf(key, *entry, stored->unit); !status.ok()) return status;
  return std::move(stored->image);
}

}  // namespace lumifold::server
