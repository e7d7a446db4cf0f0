#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "server/scheduler/unit_index.h"

namespace lumifold::scheduler {

/// Audits: accepted units that further workers render, so that their results can be compared. A vote is a
/// worker's digest of the pixels. Two equal digests settle an audit; while all differ, further workers vote.
/// Pure state. Time: O(log n) a call, unless it says otherwise.
///
/// Threads: one at a time.
class AuditBook {
 public:
  /// Audits of a job.
  struct Counts {
    int64_t open = 0;
    int64_t settled = 0;
    int64_t waived = 0;
  };
  enum class Outcome {
    kOpen,       // a further worker is to vote
    kSettled,    // two workers agree
    kUndecided,  // so many differ that no majority will tell who is right
  };
  struct Verdict {
    Outcome outcome = Outcome::kOpen;
    std::vector<std::string>
        wrong;  // of a settled audit: workers that differ from the majority, as they voted
  };

  /// An audit for which no other worker has been available for `patience` may be waived.
  explicit AuditBook(absl::Duration patience) : patience_(patience) {}

  /// Begins the audit of a unit that `worker` delivered. Without a name or a digest nothing can be compared:
  /// it is waived, and false.
  bool Begin(const UnitIndex& unit, const std::string& worker, absl::string_view digest, absl::Time now);
  /// Ends an audit, which is not leased; false if there is none.
  bool End(const UnitIndex& unit);
  /// Whether a unit of the frame is being audited.
  bool HasOpen(int64_t job, int frame) const;

  /// Whether a unit of the job is to be leased for its audit.
  bool HasReady(int64_t job) const;
  /// Takes the unit with the fewest votes that the worker may render: it has neither voted nor declined.
  /// Looks at a few only. nullopt if there is none.
  std::optional<Place> Take(int64_t job, const std::string& worker);
  /// The unit is no longer leased for its audit, and is ready again. False if it is not audited.
  bool Return(const UnitIndex& unit);
  /// The worker could not render the unit, which is audited and leased.
  void Decline(const UnitIndex& unit, const std::string& worker);
  /// A worker that has leased the unit votes. An open audit is ready again; others are to be ended.
  Verdict Vote(const UnitIndex& unit, const std::string& worker, absl::string_view digest, absl::Time now);

  /// Audits that have been open since `patience`: each is to be extended, or waived and ended.
  std::vector<UnitIndex> TakeDue(absl::Time now);
  /// When the next one may be due; InfiniteFuture without audits.
  absl::Time NextDue() const;
  void Extend(const UnitIndex& unit, absl::Time now);
  /// Counts the audit, which is not leased, as waived and ends it.
  void Waive(const UnitIndex& unit);
  /// The unit is audited, here and below.
  bool IsLeased(const UnitIndex& unit) const;
  /// Names of the workers that have voted or declined.
  std::set<std::string> AskedOf(const UnitIndex& unit) const;

  Counts CountsOf(int64_t job) const;
  /// The first unit of the job that is audited; the job has one.
  const Place& FirstOf(int64_t job) const { return jobs_.at(job).audits.begin()->first; }
  /// Forgets a job.
  void EndJob(int64_t job) { jobs_.erase(job); }

 private:
  struct Ballot {
    std::string worker;  // name
    std::string digest;
  };
  struct Audit {
    std::vector<Ballot> votes;       // the first is that of the accepted result
    std::set<std::string> declined;  // workers that could not render the unit
    absl::Time deadline;             // when it may be waived
    bool leased = false;
  };
  struct JobAudits {
    std::map<Place, Audit> audits;
    std::set<std::pair<int, Place>> ready;  // those to lease, by number of votes
    int64_t settled = 0;
    int64_t waived = 0;
  };

  Audit* Find(const UnitIndex& unit);
  const Audit& Get(const UnitIndex& unit) const { return jobs_.at(unit.job).audits.at(unit.place); }

  const absl::Duration patience_;
  std::map<int64_t, JobAudits> jobs_;
  std::set<std::pair<absl::Time, UnitIndex>> deadlines_;  // some of audits that have ended
};

}  // namespace lumifold::scheduler
