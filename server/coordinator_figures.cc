// What the metrics endpoint shows.
#include "server/coordinator_impl.h"
#include "server/job_status.h"

namespace lumifold::server {

monitoring::FarmFigures Coordinator::Figures() {
  monitoring::FarmFigures figures;
  absl::MutexLock lock(&mutex_);
  const scheduler::Figures counts = scheduler_.CountAll();
  figures.units_queued = counts.units_queued;
  figures.units_leased = counts.units_leased;
  figures.units_committed = units_committed_;
  figures.worker_slots = counts.slots;
  figures.workers = counts.workers;
  for (const auto& [job, record] : active_jobs_)
    ++figures.jobs[StateOfActiveJob(record, scheduler_.Progress(job))];
  return figures;
}

}  // namespace lumifold::server
