// The state of a job in numbers, and the reasons why it does not run.
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "server/scheduler/scheduler.h"

namespace lumifold::scheduler {

using job::Attempt;
using job::JobId;
using job::WorkerId;

namespace {

/// Names in a reason.
constexpr size_t kMaxNames = 4;

std::string Describe(const Requirement& requirement) {
  std::string text =
      requirement.numeric_class.empty() ? "any class" : absl::StrCat("class ", requirement.numeric_class);
  if (!requirement.tags.empty())
    absl::StrAppend(&text, " with the tags ", absl::StrJoin(requirement.tags, ", "));
  return text;
}

std::string Seconds(absl::Duration duration) {
  return absl::StrCat(absl::ToInt64Seconds(absl::Ceil(duration, absl::Seconds(1))), " s");
}

}  // namespace

JobProgress Scheduler::Progress(const JobId& id) const {
  const Job& job = GetJob(id);
  const bool needs_plan = job::NeedsPlan(job.spec);
  const int frames = needs_plan ? job::FrameList(job.spec).count() : job.frame_list.count();
  JobProgress progress;
  progress.units_done = job.committed_units;
  progress.units_total = UnitsTotal(job);
  progress.samples_done = job.committed_samples;
  progress.samples_total =
      int64_t{job.spec.width()} * job.spec.height() * job.spec.samples_per_pixel() * frames;
  progress.frames_done = job.finished_count;
  progress.frames_total = frames;
  progress.workers = static_cast<int>(job.holders.size());
  progress.leases = job.lease_count;
  progress.audits_settled = job.audits_settled;
  progress.audits_waived = job.audits_waived;
  const bool started = job.is_bound || job.committed_units > 0 || job.lease_count > 0;
  if (job.finished_count == frames) {
    progress.state = v1::JOB_STATE_DONE;
  } else if (job.paused) {
    progress.state = v1::JOB_STATE_PAUSED;
  } else if (!job.committed_frames.empty()) {
    progress.state = v1::JOB_STATE_FILTERING;
  } else {
    const v1::JobState waiting = needs_plan ? v1::JOB_STATE_SUBMITTED : v1::JOB_STATE_PLANNED;
    progress.state = started ? v1::JOB_STATE_RUNNING : waiting;
  }
  return progress;
}

Figures Scheduler::CountAll() const {
  Figures figures;
  figures.leases_expired = leases_expired_;
  figures.retries = retries_;
  for (const auto& [number, job] : jobs_) {
    figures.units_leased += job.leased_units;
    if (!job.paused) figures.units_queued += UnitsTotal(job) - job.committed_units - job.leased_units;
  }
  for (const auto& [index, worker] : accepted_) figures.units_queued -= jobs_.at(index.job).paused ? 0 : 1;
  for (const WorkerId id : workers_.After(WorkerId(0), std::numeric_limits<int>::max())) {
    const Worker& worker = *workers_.Find(id);
    figures.slots += worker.traits.slots;
    ++figures.workers[StateOf(worker)];
  }
  return figures;
}

std::vector<Reason> Scheduler::Explain(const JobId& id, absl::Time now) const {
  std::vector<Reason> reasons;
  const auto found = jobs_by_id_.find(id);
  if (found == jobs_by_id_.end()) return reasons;
  const Job& job = jobs_.at(found->second);
  const int64_t units = UnitsTotal(job);
  if (job.paused) reasons.push_back({"paused", "the job is paused"});
  if (job.committed_units < units) {
    ExplainWorkers(found->second, &reasons);
    ExplainLimits(job, &reasons);
    ExplainUnits(found->second, now, &reasons);
    ExplainOverdue(found->second, now, &reasons);
  }
  if (!job.audits.empty()) {
    reasons.push_back(
        {"audit",
         absl::StrCat(job.audits.size(), " units are rendered a second time to compare them, the first is ",
                      job::Describe(RefOf({found->second, job.audits.begin()->first})))});
  }
  if (!job.committed_frames.empty()) {
    reasons.push_back({"filtering", absl::StrCat(job.committed_frames.size(),
                                                 " rendered frames are being filtered or wait for it")});
  }
  return reasons;
}

std::string Scheduler::BusiestUsers() const {
  std::map<std::string, int64_t> leases;
  for (const auto& [number, job] : jobs_) leases[share_.UserOf(number)] += job.lease_count;
  std::vector<std::pair<int64_t, std::string>> users;
  users.reserve(leases.size());
  for (const auto& [user, count] : leases) users.emplace_back(-count, user);
  std::sort(users.begin(), users.end());
  if (users.size() > kMaxNames) users.resize(kMaxNames);
  return absl::StrJoin(users, ", ", [](std::string* text, const auto& user) {
    absl::StrAppend(text, "user ", user.second.empty() ? "anonymous" : user.second, " has ", -user.first);
  });
}

void Scheduler::ExplainWorkers(int64_t number, std::vector<Reason>* reasons) const {
  const Job& job = jobs_.at(number);
  const Requirement& requirement = RequirementOf(job);
  const KindCounts workers = workers_.Count(requirement);
  if (workers.connected == 0) {
    reasons->push_back(
        {"no_worker", absl::StrCat("the job needs workers of ", Describe(requirement), ", and none of the ",
                                   workers_.Count({}).connected, " connected workers is")});
    return;
  }
  if (workers.available == 0) {
    reasons->push_back(
        {"worker_unavailable",
         absl::StrCat("all ", workers.connected, " connected workers of ", Describe(requirement),
                      " are blocked, draining, set aside (", workers.set_aside, ") or silent")});
    return;
  }
  if (job.readiness == Readiness::kNone || workers.busy < workers.slots) return;
  reasons->push_back(
      {"slots_busy", absl::StrCat("all ", workers.slots, " slots of the ", workers.available,
                                  " workers that may render the job are busy: it has ", job.lease_count,
                                  " leases, ", BusiestUsers(), "; the share of its user is ",
                                  std::lround(100 * share_.ShareOfUser(number)), " %")});
}

void Scheduler::ExplainLimits(const Job& job, std::vector<Reason>* reasons) const {
  if (job.max_leases > 0 && job.lease_count >= job.max_leases) {
    reasons->push_back(
        {"max_leases", absl::StrCat("the job has ", job.lease_count,
                                    " leases, which is its own limit (max_leases ", job.max_leases, ")")});
  }
  if (job.readiness == Readiness::kOpensFrame && !MayOpenFrame()) {
    reasons->push_back({"frames_in_flight",
                        absl::StrCat("the next frame waits until one of the ", active_frames(),
                                     " frames in flight is finished; their limit is ", max_active_frames_)});
  }
}

void Scheduler::ExplainUnits(int64_t number, absl::Time now, std::vector<Reason>* reasons) const {
  const Job& job = jobs_.at(number);
  if (!job.delayed.empty()) {
    const auto last = std::max_element(job.delayed.begin(), job.delayed.end(),
                                       [](const auto& a, const auto& b) { return a.second < b.second; });
    reasons->push_back(
        {"backoff",
         absl::StrCat(job.delayed.size(), " units wait after failures; the longest is ",
                      job::Describe(RefOf({number, last->first})), ", for ", Seconds(last->second - now))});
  }
  const auto first = quarantine_.lower_bound({number, {}});
  if (first != quarantine_.end() && first->job == number) {
    reasons->push_back(
        {"quarantine",
         absl::StrCat(std::distance(first, quarantine_.lower_bound({number + 1, {}})),
                      " units with which workers were lost wait for a worker of their own, the first is ",
                      job::Describe(RefOf(*first)))});
  }
  std::vector<std::string> aside;
  std::set<WorkerId> failed;
  for (const auto& [place, history] : job.history) {
    failed.insert(history.failed_workers.begin(), history.failed_workers.end());
  }
  for (const WorkerId worker : failed) {
    if (!SetAsideReason(worker).empty() && aside.size() < kMaxNames)
      aside.push_back(workers_.Find(worker)->traits.name);
  }
  if (!aside.empty()) {
    reasons->push_back(
        {"worker_set_aside",
         absl::StrCat("workers that failed units of the job are set aside: ", absl::StrJoin(aside, ", "))});
  }
}

void Scheduler::ExplainOverdue(int64_t number, absl::Time now, std::vector<Reason>* reasons) const {
  const Lease* slowest = nullptr;
  for (const Attempt attempt : leases_.OfJob(number)) {
    const Lease* lease = leases_.Find(attempt);
    if (lease->is_overdue && (slowest == nullptr || lease->granted < slowest->granted)) slowest = lease;
  }
  if (slowest == nullptr) return;
  const UnitTimes& times = TimesOf(jobs_.at(number), slowest->unit.place);
  reasons->push_back(
      {"overdue",
       absl::StrCat(job::Describe(RefOf(slowest->unit)), " has been leased to worker ",
                    workers_.Find(slowest->worker)->traits.name, " for ", Seconds(now - slowest->granted),
                    "; the mean of the job is ", Seconds(times.sum / times.count))});
}

}  // namespace lumifold::scheduler
