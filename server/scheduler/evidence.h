#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/time/time.h"
#include "server/job/ids.h"
#include "server/scheduler/types.h"
#include "server/scheduler/unit_index.h"
#include "server/scheduler/worker_pool.h"

namespace lumifold::scheduler {

/// What workers say of units that they could not render. Who can err by itself is a party: the workers with
/// one certificate, or on one machine (WorkerTraits::party). A party calls a unit impossible when it reports
/// a failure as permanent, fails the unit DisputeOptions::max_failures times, or is lost while it renders
/// nothing else. It is a witness if it has delivered a unit: what never worked says nothing about a job.
/// Disputes decides what follows. Pure state. Time: O(log n) a call, unless it says otherwise.
/// Threads: one at a time.
class Evidence {
 public:
  /// What one party says of a unit.
  struct Statement {
    int failures = 0;
    bool impossible = false;
    bool by_loss = false;
    uint64_t instance = 0;  // of the process that said so last, see WorkerTraits
  };
  struct Record {
    int failures = 0;  // of all parties
    /// The last worker that failed or dropped it, by name: it may reconnect.
    std::string last_worker;
    std::string last_error;
    std::set<job::WorkerId> workers;              // that failed or dropped it
    std::map<std::string, Statement> statements;  // by party
    absl::Time due = absl::InfiniteFuture();

    /// Parties that call the unit impossible.
    int Parties() const;
  };

  explicit Evidence(const SchedulerOptions& options)
      : max_failures_(options.disputes.max_failures), exclusion_(options.cool_down) {}

  /// A connected worker could not render a unit.
  const Record& AddFailure(const UnitIndex& unit, job::WorkerId id, const Worker& worker, bool permanent,
                           const std::string& error, absl::Time now);
  /// A connected worker no longer renders a unit and does not say why: no failure, but the unit goes to
  /// another one if there is one.
  void AddDrop(const UnitIndex& unit, job::WorkerId id, const Worker& worker);
  /// The unit ended the party's workers.
  void AddLoss(const UnitIndex& unit, const std::string& party, const std::string& error, absl::Time now);
  /// The loss did not end the worker after all.
  void RetractLoss(const UnitIndex& unit, const std::string& party);

  /// Null if nothing is known against the unit; valid until the next call that changes anything.
  const Record* Find(const UnitIndex& unit) const;
  /// The parties of Record::Parties that are witnesses.
  int WitnessesOf(const Record& record) const;
  /// Whether the worker with this name was the last to fail or drop the unit.
  bool WasLastToFail(const UnitIndex& unit, const std::string& name) const;
  /// Whether the party called a unit of the job impossible lately: it gets no unit of the job, but the first
  /// one in dispute if it is asked about that.
  bool IsExcluded(int64_t job, const std::string& party, absl::Time now) const;
  /// Whether another party calls the unit impossible, and this one does not.
  bool IsAskedAbout(const UnitIndex& unit, const std::string& party) const;
  /// Workers that failed or dropped free units of the job. O(such units).
  std::set<job::WorkerId> FailedWorkersOf(int64_t job) const;
  /// The unit of the job that a party called impossible first, of those that are not rendered. O(units of the
  /// job with records).
  std::optional<UnitIndex> FirstDispute(int64_t job) const;
  /// The first one that failed and that no party calls impossible. O(the same).
  std::optional<UnitIndex> FirstFailure(int64_t job) const;

  /// When the unit, which has a record, is to be judged again.
  void SetDue(const UnitIndex& unit, absl::Time due);
  /// Units that are due at `now`, in the order of their times; they are due no more.
  std::vector<UnitIndex> TakeDue(absl::Time now);
  absl::Time NextDue() const { return due_.empty() ? absl::InfiniteFuture() : due_.begin()->first; }

  /// The unit is rendered: what was said against it is forgotten. Returns the workers that said it.
  std::set<job::WorkerId> Refute(const UnitIndex& unit);
  /// The party has delivered a unit. What it says of others counts as that of a witness, also what it said
  /// before.
  void AddWitness(const std::string& party) { witnesses_.insert(party); }
  /// A process of the party has connected. What another one reported as impossible this one may render; what
  /// it reported itself before its connection broke holds. O(records).
  void AddProcess(const std::string& party, uint64_t instance);
  void EndJob(int64_t job);

 private:
  Record& RecordOf(const UnitIndex& unit, job::WorkerId id, const Worker& worker);
  void CallImpossible(const UnitIndex& unit, const std::string& party, Statement* statement, absl::Time now);
  void Erase(std::map<UnitIndex, Record>::iterator record);

  const int max_failures_;
  const absl::Duration exclusion_;
  std::set<std::string> witnesses_;  // parties
  std::map<UnitIndex, Record> records_;
  std::set<std::pair<absl::Time, UnitIndex>> due_;
  std::map<int64_t, UnitIndex> first_disputes_;                     // by job; some are settled
  std::map<std::pair<int64_t, std::string>, absl::Time> excluded_;  // job and party, until when
};

}  // namespace lumifold::scheduler
