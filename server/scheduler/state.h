#pragma once

#include <algorithm>
#include <vector>

#include "absl/time/time.h"
#include "server/job/ids.h"
#include "server/job/unit.h"
#include "server/scheduler/accepted_units.h"
#include "server/scheduler/active_jobs.h"
#include "server/scheduler/audit_book.h"
#include "server/scheduler/backoffs.h"
#include "server/scheduler/evidence.h"
#include "server/scheduler/lease_table.h"
#include "server/scheduler/name_table.h"
#include "server/scheduler/quarantine.h"
#include "server/scheduler/ready_jobs.h"
#include "server/scheduler/second_leases.h"
#include "server/scheduler/types.h"
#include "server/scheduler/worker_health.h"
#include "server/scheduler/worker_pool.h"

namespace lumifold::scheduler {

/// The scheduler's state: a part for each thing. What one part decides is that part's; rules that concern
/// several parts are in the classes that Scheduler composes.
struct State {
  explicit State(const SchedulerOptions& scheduler_options);
  State(const State&) = delete;
  State& operator=(const State&) = delete;

  /// A call states the time.
  void SetTime(absl::Time now) { latest = std::max(latest, now); }
  /// The lease of the worker for the unit with this attempt; null if there is none.
  const Lease* FindLease(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt) const;
  const Requirement& RequirementOf(const Job& job) const { return ready.RequirementOf(job.number); }
  SecondLeases::Kind KindOf(const UnitIndex& unit) const;
  /// To be called when the free units of a job have changed, or whether it may lease them.
  void UpdateReady(Job& job);

  const SchedulerOptions options;
  absl::Time latest = absl::InfinitePast();  // that a call has stated
  ActiveJobs jobs;
  WorkerPool workers;
  LeaseTable leases;
  ReadyJobs ready;
  SecondLeases second_leases;
  AuditBook audits;
  Quarantine quarantine;
  Evidence evidence;
  WorkerHealth health;
  Backoffs backoffs;
  NameTable deliverers;  // of the units of active frames
  AcceptedUnits accepted;
  std::vector<FailedJob> failed;  // that the caller has not taken yet
};

}  // namespace lumifold::scheduler
