#pragma once

#include <cstdint>
#include <map>
#include <optional>

#include "lumifold/v1/job.pb.h"
#include "server/job/ids.h"
#include "server/job/unit.h"
#include "server/scheduler/free_units.h"
#include "server/scheduler/job_frames.h"
#include "server/scheduler/job_units.h"
#include "server/scheduler/kept_frames.h"
#include "server/scheduler/types.h"
#include "server/scheduler/unit_index.h"

namespace lumifold::scheduler {

/// Leases of a job.
struct JobLeases {
  int limit = 0;  // 0: none
  int64_t count = 0;
  int64_t units = 0;                     // with one lease or two, not counting audits
  std::map<job::WorkerId, int> holders;  // number of leases; never 0

  bool IsFull() const { return limit > 0 && count >= limit; }
};

/// An active job, as far as no other part knows of it.
struct Job {
  Job(int64_t job_number, const job::JobId& job_id, const v1::JobSpec& spec, const JobOptions& options)
      : number(job_number),
        id(job_id),
        units(spec),
        frames(units.frames().count()),
        leases{.limit = options.max_leases, .holders = {}},
        audit_share(options.audit_share),
        paused(options.paused) {}

  int64_t number;  // in the order of arrival
  job::JobId id;
  JobUnits units;
  JobFrames frames;
  FreeUnits free;
  JobLeases leases;
  double audit_share;
  KeepDemand keep{};
  bool paused;
  bool is_bound = false;  // a unit was accepted
};

/// The active jobs, by id and by number. Pure state. Time: O(log n) a call.
///
/// Threads: one at a time.
class ActiveJobs {
 public:
  /// `id` is new.
  Job& Add(const job::JobId& id, const v1::JobSpec& spec, const JobOptions& options);
  void Remove(int64_t number);

  /// Null for an unknown job; valid until Remove.
  Job* Find(const job::JobId& id);
  const Job* Find(const job::JobId& id) const;
  bool Has(int64_t number) const { return jobs_.contains(number); }
  /// The job is known.
  Job& Get(int64_t number) { return jobs_.at(number); }
  const Job& Get(int64_t number) const { return jobs_.at(number); }
  const Job& Get(const job::JobId& id) const { return jobs_.at(numbers_.at(id)); }
  std::map<int64_t, Job>& all() { return jobs_; }
  const std::map<int64_t, Job>& all() const { return jobs_; }

  /// Which of their frames workers keep.
  KeptFrames& kept() { return kept_; }
  const KeptFrames& kept() const { return kept_; }

  /// nullopt for a unit that no active job has.
  std::optional<UnitIndex> IndexOf(const job::UnitRef& unit) const;
  /// The inverse.
  job::UnitRef RefOf(const UnitIndex& unit) const;

 private:
  int64_t next_ = 0;
  std::map<int64_t, Job> jobs_;
  std::map<job::JobId, int64_t> numbers_;
  KeptFrames kept_;
};

}  // namespace lumifold::scheduler
