#include "server/scheduler/evidence.h"

#include <algorithm>

namespace lumifold::scheduler {

using job::WorkerId;

int Evidence::Record::Parties() const {
  return static_cast<int>(std::count_if(statements.begin(), statements.end(),
                                        [](const auto& entry) { return entry.second.impossible; }));
}

int Evidence::WitnessesOf(const Record& record) const {
  return static_cast<int>(std::count_if(
      record.statements.begin(), record.statements.end(),
      [this](const auto& entry) { return entry.second.impossible && witnesses_.contains(entry.first); }));
}

Evidence::Record& Evidence::RecordOf(const UnitIndex& unit, WorkerId id, const Worker& worker) {
  Record& record = records_[unit];
  record.last_worker = worker.traits.name;
  record.workers.insert(id);
  return record;
}

const Evidence::Record& Evidence::AddFailure(const UnitIndex& unit, WorkerId id, const Worker& worker,
                                             bool permanent, const std::string& error, absl::Time now) {
  Record& record = RecordOf(unit, id, worker);
  ++record.failures;
  record.last_error = error;
  Statement& statement = record.statements[worker.traits.party];
  statement.instance = worker.traits.instance;
  if (++statement.failures >= max_failures_ || permanent)
    CallImpossible(unit, worker.traits.party, &statement, now);
  return record;
}

void Evidence::AddDrop(const UnitIndex& unit, WorkerId id, const Worker& worker) {
  RecordOf(unit, id, worker);
}

void Evidence::AddLoss(const UnitIndex& unit, const std::string& party, const std::string& error,
                       absl::Time now) {
  Record& record = records_[unit];
  record.last_error = error;
  Statement& statement = record.statements[party];
  statement.by_loss = true;
  CallImpossible(unit, party, &statement, now);
}

void Evidence::CallImpossible(const UnitIndex& unit, const std::string& party, Statement* statement,
                              absl::Time now) {
  if (!FirstDispute(unit.job).has_value()) first_disputes_[unit.job] = unit;
  statement->impossible = true;
  excluded_[{unit.job, party}] = now + exclusion_;
}

void Evidence::RetractLoss(const UnitIndex& unit, const std::string& party) {
  const auto record = records_.find(unit);
  if (record == records_.end()) return;
  const auto statement = record->second.statements.find(party);
  if (statement == record->second.statements.end() || !statement->second.by_loss) return;
  record->second.statements.erase(statement);
  excluded_.erase({unit.job, party});
}

const Evidence::Record* Evidence::Find(const UnitIndex& unit) const {
  const auto record = records_.find(unit);
  return record == records_.end() ? nullptr : &record->second;
}

bool Evidence::WasLastToFail(const UnitIndex& unit, const std::string& name) const {
  const Record* const record = Find(unit);
  return record != nullptr && record->last_worker == name;
}

bool Evidence::IsExcluded(int64_t job, const std::string& party, absl::Time now) const {
  const auto excluded = excluded_.find({job, party});
  return excluded != excluded_.end() && now < excluded->second;
}

bool Evidence::IsAskedAbout(const UnitIndex& unit, const std::string& party) const {
  const Record* const record = Find(unit);
  if (record == nullptr || record->Parties() == 0) return false;
  const auto own = record->statements.find(party);
  return own == record->statements.end() || !own->second.impossible;
}

std::set<WorkerId> Evidence::FailedWorkersOf(int64_t job) const {
  std::set<WorkerId> workers;
  for (auto it = records_.lower_bound({job, {}}); it != records_.end() && it->first.job == job; ++it)
    workers.insert(it->second.workers.begin(), it->second.workers.end());
  return workers;
}

std::optional<UnitIndex> Evidence::FirstDispute(int64_t job) const {
  if (const auto first = first_disputes_.find(job); first != first_disputes_.end()) {
    const Record* const record = Find(first->second);
    if (record != nullptr && record->Parties() > 0) return first->second;
  }
  for (auto it = records_.lower_bound({job, {}}); it != records_.end() && it->first.job == job; ++it) {
    if (it->second.Parties() > 0) return it->first;
  }
  return std::nullopt;
}

std::optional<UnitIndex> Evidence::FirstFailure(int64_t job) const {
  for (auto it = records_.lower_bound({job, {}}); it != records_.end() && it->first.job == job; ++it) {
    if (it->second.failures > 0 && it->second.Parties() == 0) return it->first;
  }
  return std::nullopt;
}

void Evidence::SetDue(const UnitIndex& unit, absl::Time due) {
  Record& record = records_.at(unit);
  due_.erase({record.due, unit});
  record.due = due;
  due_.emplace(due, unit);
}

std::vector<UnitIndex> Evidence::TakeDue(absl::Time now) {
  std::vector<UnitIndex> units;
  while (NextDue() <= now) {
    units.push_back(due_.begin()->second);
    records_.at(units.back()).due = absl::InfiniteFuture();
    due_.erase(due_.begin());
  }
  return units;
}

std::set<WorkerId> Evidence::Refute(const UnitIndex& unit) {
  const auto record = records_.find(unit);
  if (record == records_.end()) return {};
  std::set<WorkerId> workers = std::move(record->second.workers);
  Erase(record);
  return workers;
}

void Evidence::Erase(std::map<UnitIndex, Record>::iterator record) {
  due_.erase({record->second.due, record->first});
  records_.erase(record);
}

void Evidence::AddProcess(const std::string& party, uint64_t instance) {
  if (instance == 0) return;  // nobody knows whether it is another one
  for (auto& [unit, record] : records_) {
    const auto own = record.statements.find(party);
    if (own == record.statements.end() || own->second.by_loss || own->second.instance == instance) continue;
    record.statements.erase(own);
    excluded_.erase({unit.job, party});
  }
}

void Evidence::EndJob(int64_t job) {
  for (auto it = records_.lower_bound({job, {}}); it != records_.end() && it->first.job == job;) Erase(it++);
  first_disputes_.erase(job);
  excluded_.erase(excluded_.lower_bound({job, ""}), excluded_.lower_bound({job + 1, ""}));
}

}  // namespace lumifold::scheduler
