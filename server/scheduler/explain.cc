// The reasons why a job does not run.
#include "server/scheduler/explain.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <limits>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "server/scheduler/audits.h"
#include "server/scheduler/disputes.h"

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

/// "user ann has 12 leases, user ben 3", the users with the most ones.
std::string BusiestUsers(const State& state) {
  std::map<std::string, int64_t> leases;
  for (const auto& [number, job] : state.jobs.all())
    leases[state.ready.share().UserOf(number)] += job.leases.count;
  std::vector<std::pair<int64_t, std::string>> users;
  users.reserve(leases.size());
  for (const auto& [user, count] : leases) users.emplace_back(-count, user);
  std::sort(users.begin(), users.end());
  if (users.size() > kMaxNames) users.resize(kMaxNames);
  return absl::StrJoin(users, ", ", [](std::string* text, const auto& user) {
    absl::StrAppend(text, "user ", user.second.empty() ? "anonymous" : user.second, " has ", -user.first);
  });
}

/// ": w-3 off hours until 19:00, w-7 ..."; empty where no worker that may render the job rests.
std::string Resting(const State& state, const Requirement& requirement) {
  std::vector<std::string> names;
  for (const WorkerId id : state.workers.After(WorkerId(0), std::numeric_limits<int>::max())) {
    const Worker& worker = *state.workers.Find(id);
    if (worker.rest.empty() || !requirement.Admits(state.workers.KindOf(worker.kind))) continue;
    names.push_back(absl::StrCat(worker.traits.name, " ", worker.rest));
    if (names.size() == kMaxNames) break;
  }
  return names.empty() ? "" : absl::StrCat(": ", absl::StrJoin(names, ", "));
}

std::string Gigabytes(uint64_t bytes) {
  return absl::StrFormat("%.1f GiB", static_cast<double>(bytes) / (1 << 30));
}

/// Whether no connected worker has enough memory, though some could render the job otherwise.
bool ExplainMemory(const State& state, const Job& job, absl::Time now, std::vector<Reason>* reasons) {
  Requirement any_memory = state.RequirementOf(job);
  any_memory.memory_bytes = 0;
  const uint64_t largest = state.workers.LargestMemory(any_memory);
  if (state.workers.Count(state.RequirementOf(job)).connected > 0 || largest == 0) return false;
  const MemoryNeeds::Need& need = state.ready.memory().Of(job.number);
  reasons->push_back(
      {"memory",
       need.planned > largest
           ? absl::StrCat("the job needs ", Gigabytes(need.planned), " of memory; the largest worker of ",
                          Describe(any_memory), " has ", Gigabytes(largest))
           : absl::StrCat("the job needs more than ", Gigabytes(need.too_little), " of memory: worker ",
                          need.worker, " ran out of it; the largest worker of ", Describe(any_memory),
                          " has ", Gigabytes(largest), ", and is tried again in ",
                          Seconds(need.until - now))});
  return true;
}

void ExplainWorkers(const State& state, const Job& job, absl::Time now, std::vector<Reason>* reasons) {
  if (ExplainMemory(state, job, now, reasons)) return;
  const Requirement& requirement = state.RequirementOf(job);
  const KindCounts workers = state.workers.Count(requirement);
  if (workers.connected == 0) {
    reasons->push_back(
        {"no_worker", absl::StrCat("the job needs workers of ", Describe(requirement), ", and none of the ",
                                   state.workers.Count({}).connected, " connected workers is")});
    return;
  }
  if (workers.available == 0) {
    reasons->push_back({"worker_unavailable",
                        absl::StrCat("all ", workers.connected, " connected workers of ",
                                     Describe(requirement), " are blocked, draining, resting, set aside (",
                                     workers.cooling, ") or silent", Resting(state, requirement))});
    return;
  }
  if (state.ready.Get(job.number) == Readiness::kNone || workers.busy < workers.slots) return;
  reasons->push_back(
      {"slots_busy", absl::StrCat("all ", workers.slots, " slots of the ", workers.available,
                                  " workers that may render the job are busy: it has ", job.leases.count,
                                  " leases, ", BusiestUsers(state), "; the share of its user is ",
                                  std::lround(100 * state.ready.share().ShareOfUser(job.number)), " %")});
}

void ExplainTurn(const State& state, const Job& job, std::vector<Reason>* reasons) {
  const std::set<FairShare::Turn> before = state.ready.share().TurnsBefore(job.number);
  if (before.empty()) return;
  reasons->push_back(
      {"turn", absl::StrCat(before.size(), before.size() == 1 ? " job" : " jobs",
                            " of its user with the same priority come", before.size() == 1 ? "s" : "",
                            " first, the next is ", state.jobs.Get(before.begin()->second).id.value())});
}

void ExplainLimits(const State& state, const Job& job, std::vector<Reason>* reasons) {
  if (job.leases.IsFull()) {
    reasons->push_back(
        {"max_leases", absl::StrCat("the job has ", job.leases.count,
                                    " leases, which is its own limit (max_leases ", job.leases.limit, ")")});
  }
  if (state.ready.Get(job.number) == Readiness::kOpensFrame && !state.ready.MayOpenFrame()) {
    reasons->push_back(
        {"frames_in_flight",
         absl::StrCat("the next frame waits until one of the ", state.ready.active_frames(),
                      " frames in flight is finished; their limit is ", state.ready.max_active_frames())});
  }
}

void ExplainFailures(const State& state, const Job& job, absl::Time now, std::vector<Reason>* reasons) {
  if (const auto longest = state.backoffs.LongestOf(job.number); longest.has_value()) {
    reasons->push_back({"backoff", absl::StrCat(state.backoffs.CountOf(job.number),
                                                " units wait after failures; the longest is ",
                                                job::Describe(state.jobs.RefOf({job.number, longest->place})),
                                                ", for ", Seconds(longest->end - now))});
  }
  const std::optional<UnitIndex> failed = state.evidence.FirstFailure(job.number);
  if (failed.has_value() && state.backoffs.CountOf(job.number) == 0) {
    const Evidence::Record& record = *state.evidence.Find(*failed);
    reasons->push_back(
        {"failures", absl::StrCat(job::Describe(state.jobs.RefOf(*failed)), " has failed ", record.failures,
                                  record.failures == 1 ? " time" : " times", ", the last time on worker ",
                                  record.last_worker, " (", record.last_error, "), and is tried again")});
  }
  if (const std::optional<UnitIndex> lost = state.quarantine.FirstLossOf(job.number); lost.has_value()) {
    const Quarantine::Losses& losses = state.quarantine.LossesOf(*lost);
    reasons->push_back(
        {"losses", absl::StrCat(losses.size(), losses.size() == 1 ? " worker was" : " workers were",
                                " lost with ", job::Describe(state.jobs.RefOf(*lost)), ", the first of ",
                                *losses.begin(), "; it is tried again")});
  }
  const std::set<UnitIndex>& quarantined = state.quarantine.waiting();
  const auto first = quarantined.lower_bound({job.number, {}});
  if (first != quarantined.end() && first->job == job.number) {
    reasons->push_back(
        {"quarantine",
         absl::StrCat(std::distance(first, quarantined.lower_bound({job.number + 1, {}})),
                      " units with which workers were lost wait for a worker of their own, the first is ",
                      job::Describe(state.jobs.RefOf(*first)))});
  }
  std::vector<std::string> cooling;
  for (const WorkerId worker : state.evidence.FailedWorkersOf(job.number)) {
    if (!state.health.CoolDownReason(worker).empty() && cooling.size() < kMaxNames)
      cooling.push_back(state.workers.Find(worker)->traits.name);
  }
  if (!cooling.empty()) {
    reasons->push_back(
        {"worker_set_aside",
         absl::StrCat("workers that failed units of the job are set aside: ", absl::StrJoin(cooling, ", "))});
  }
}

void ExplainDispute(const State& state, const Job& job, absl::Time now, std::vector<Reason>* reasons) {
  const std::optional<UnitIndex> unit = state.evidence.FirstDispute(job.number);
  if (!unit.has_value()) return;
  const Evidence::Record& record = *state.evidence.Find(*unit);
  std::vector<std::string> parties;
  for (const auto& [party, statement] : record.statements) {
    if (statement.impossible && parties.size() < kMaxNames) parties.push_back(party);
  }
  const std::string who =
      absl::StrCat(parties.size() == 1 ? "worker " : "workers ", absl::StrJoin(parties, ", "));
  std::string next = "another worker is asked";
  if (!Disputes::CanAskAnother(state, *unit)) {
    next =
        state.evidence.WitnessesOf(record) > 0 || record.Parties() > 1
            ? absl::StrCat("the job fails in ", Seconds(record.due - now), " unless another worker connects")
            : absl::StrCat("the job waits for another worker, because this one has delivered nothing yet");
  }
  reasons->push_back(
      {"second_opinion", absl::StrCat(who, " cannot render ", job::Describe(state.jobs.RefOf(*unit)), " (",
                                      record.last_error, "); ", next)});
}

void ExplainOverdue(const State& state, const Job& job, absl::Time now, std::vector<Reason>* reasons) {
  const Lease* slowest = nullptr;
  for (const Attempt attempt : state.leases.OfJob(job.number)) {
    const Lease* lease = state.leases.Find(attempt);
    const bool stands_still = lease->progressed + state.options.lease <= now;
    if ((lease->is_overdue || stands_still) && (slowest == nullptr || lease->granted < slowest->granted))
      slowest = lease;
  }
  if (slowest == nullptr) return;
  const std::string what = absl::StrCat(
      job::Describe(state.jobs.RefOf(slowest->unit)), " has been leased to worker ",
      state.workers.Find(slowest->worker)->traits.name, " for ", Seconds(now - slowest->granted));
  const std::optional<absl::Duration> mean = state.second_leases.MeanOf(state.KindOf(slowest->unit));
  if (slowest->is_overdue && mean.has_value()) {
    reasons->push_back({"overdue", absl::StrCat(what, "; the mean of the job is ", Seconds(*mean))});
  } else {
    reasons->push_back({"no_progress", absl::StrCat(what, ", and has made no progress for ",
                                                    Seconds(now - slowest->progressed),
                                                    "; the next worker that is idle gets it too")});
  }
}

}  // namespace

std::vector<Reason> Explain(const State& state, const JobId& id, absl::Time now) {
  std::vector<Reason> reasons;
  const Job* const job = state.jobs.Find(id);
  if (job == nullptr) return reasons;
  if (job->paused) reasons.push_back({"paused", "the job is paused"});
  if (job->frames.committed_units() < job->units.total()) {
    ExplainWorkers(state, *job, now, &reasons);
    ExplainTurn(state, *job, &reasons);
    ExplainLimits(state, *job, &reasons);
    ExplainFailures(state, *job, now, &reasons);
    ExplainDispute(state, *job, now, &reasons);
    ExplainOverdue(state, *job, now, &reasons);
  }
  if (const int64_t audits = state.audits.CountsOf(job->number).open; audits > 0) {
    const UnitIndex first{job->number, state.audits.FirstOf(job->number)};
    reasons.push_back(
        {"audit",
         absl::StrCat(audits, " units are rendered a second time to compare them, the first is ",
                      job::Describe(state.jobs.RefOf(first)),
                      Audits::HasAuditor(state, first)
                          ? ""
                          : absl::StrCat("; no worker of another name is available, and what nobody "
                                         "compares within ",
                                         Seconds(state.options.audit_patience), " is not compared"))});
  }
  if (const int kept = state.jobs.kept().CountOf(job->number); kept > 0) {
    reasons.push_back(
        {"frames_kept", absl::StrCat("each of ", kept,
                                     " frames is rendered by one worker, which keeps its "
                                     "units and filters it: its file alone comes to the coordinator")});
  }
  if (!job->frames.committed().empty()) {
    reasons.push_back({"filtering", absl::StrCat(job->frames.committed().size(),
                                                 " rendered frames are being filtered or wait for it")});
  }
  return reasons;
}

}  // namespace lumifold::scheduler
