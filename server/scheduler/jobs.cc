#include "server/scheduler/jobs.h"

#include <cstdint>
#include <optional>

#include "server/job/plan.h"

namespace lumifold::scheduler {

using job::JobId;

Jobs::Jobs(State* state, Frames* frames, Leasing* leasing)
    : state_(state), frames_(frames), leasing_(leasing) {}

void Jobs::Add(const JobId& id, const v1::JobSpec& spec, const JobOptions& options) {
  Job& job = state_->jobs.Add(id, spec, options);
  state_->ready.Add(job.number, options);
  state_->ready.memory().SetPlanned(job.number, job::MemoryNeedOf(spec));
  Requirement requirement = state_->RequirementOf(job);
  requirement.memory_bytes = state_->ready.memory().Of(job.number).bytes();
  state_->ready.SetRequirement(job.number, requirement, state_->latest);
  state_->UpdateReady(job);
}

void Jobs::End(const JobId& id) {
  Job* const job = state_->jobs.Find(id);
  if (job == nullptr) return;
  const int64_t number = job->number;
  leasing_->RevokeOfJob(number);
  for (const UnitIndex& unit : state_->accepted.OfJob(number)) {
    if (const std::optional<job::WorkerId> worker = state_->accepted.Remove(unit))
      leasing_->ReleaseSlot(*worker);
  }
  frames_->Leave(*job);
  state_->jobs.kept().CloseJob(number);
  state_->quarantine.EndJob(number);
  state_->audits.EndJob(number);
  state_->second_leases.ForgetTimes(number);
  state_->evidence.EndJob(number);
  state_->backoffs.ForgetJob(number);
  state_->ready.memory().EndJob(number);
  state_->ready.Remove(number);
  state_->jobs.Remove(number);
}

void Jobs::Pause(const JobId& id) {
  Job* const job = state_->jobs.Find(id);
  if (job == nullptr || job->paused) return;
  frames_->CountActive(*job, false);
  job->paused = true;
  state_->UpdateReady(*job);
  state_->quarantine.CancelOfJob(job->number);
}

void Jobs::Resume(const JobId& id) {
  Job* const job = state_->jobs.Find(id);
  if (job == nullptr || !job->paused) return;
  job->paused = false;
  frames_->CountActive(*job, true);
  state_->UpdateReady(*job);
}

void Jobs::SetPriority(const JobId& id, int priority) {
  if (const Job* job = state_->jobs.Find(id); job != nullptr)
    state_->ready.SetPriority(job->number, priority);
}

void Jobs::SetTurn(const JobId& id, int64_t turn) {
  if (const Job* job = state_->jobs.Find(id); job != nullptr) state_->ready.SetTurn(job->number, turn);
}

int64_t Jobs::TurnOfFirst(const JobId& id) const {
  return state_->ready.share().FirstTurn(state_->jobs.Get(id).number);
}

JobProgress Jobs::Progress(const JobId& id) const {
  const Job& job = state_->jobs.Get(id);
  const v1::JobSpec& spec = job.units.spec();
  const bool needs_plan = job::NeedsPlan(spec);
  const int all_frames = needs_plan ? job::FrameList(spec).count() : job.units.frames().count();
  const int frames = all_frames - job.frames.skipped_count();
  const AuditBook::Counts audits = state_->audits.CountsOf(job.number);
  JobProgress progress;
  progress.units_done = job.frames.committed_units();
  progress.units_total = job.units.total();
  progress.samples_done = job.frames.committed_samples();
  progress.samples_total = int64_t{spec.width()} * spec.height() * spec.samples_per_pixel() * frames;
  progress.frames_done = job.frames.finished_count();
  progress.frames_skipped = job.frames.skipped_count();
  progress.frames_total = all_frames;
  progress.workers = static_cast<int>(job.leases.holders.size());
  progress.leases = job.leases.count;
  progress.audits_settled = audits.settled;
  progress.audits_waived = audits.waived;
  const bool started = job.is_bound || progress.units_done > 0 || progress.leases > 0;
  if (job.frames.AreAllOver()) {
    progress.state = v1::JOB_STATE_DONE;
  } else if (job.paused) {
    progress.state = v1::JOB_STATE_PAUSED;
  } else if (!job.frames.committed().empty()) {
    progress.state = v1::JOB_STATE_FILTERING;
  } else {
    const v1::JobState waiting = needs_plan ? v1::JOB_STATE_SUBMITTED : v1::JOB_STATE_PLANNED;
    progress.state = started ? v1::JOB_STATE_RUNNING : waiting;
  }
  return progress;
}

const std::string& Jobs::NumericClassOf(const JobId& id) const {
  return state_->RequirementOf(state_->jobs.Get(id)).numeric_class;
}

const v1::JobSpec& Jobs::SpecOf(const JobId& id) const { return state_->jobs.Get(id).units.spec(); }

const job::FrameUnits& Jobs::UnitsOf(const JobId& id) const { return state_->jobs.Get(id).units.of_frame(); }

}  // namespace lumifold::scheduler
