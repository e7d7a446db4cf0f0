#include "tests/unit/ledger/history.h"

#include <algorithm>
#include <map>
#include <random>
#include <utility>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "tests/support/filled_message.h"
#include "tests/unit/ledger/job_store_fixture.h"

namespace lumifold::ledger {
namespace {

using job::JobId;

std::string CodeOf(const absl::Status& status) { return absl::StatusCodeToString(status.code()); }

/// The outcome of a call without a result. Only what storage may cause is an error of the step.
absl::StatusOr<std::string> Outcome(const absl::Status& status) {
  if (absl::IsUnavailable(status) || absl::IsDataLoss(status) || absl::IsInternal(status)) return status;
  return CodeOf(status);
}

std::string TextOf(const JobRecord& job) {
  return absl::StrCat(job.id.value(), " ", absl::CEscape(job.spec.SerializeAsString()), " ",
                      absl::CEscape(job.scheduling.SerializeAsString()), " ", job.owner.name, " ",
                      job.owner.epoch.value(), " ", static_cast<int>(job.state), " ", job.error, " ",
                      job.numeric_class, " ", absl::ToUnixMillis(job.submitted), " ",
                      absl::ToUnixMillis(job.started), " ", job.done.units, " ", job.done.samples, " ",
                      job.done.bad_samples, " ", job.done.frames, " ", job.counted.value(), " ",
                      job.times.ShortDebugString(), " ", job.estimated_error.value_or(-1), " ",
                      absl::StrJoin(job.warnings, "|"), " ", job.warnings_left_out, "\n");
}

std::string TextOf(const UnitRecord& unit) {
  return absl::StrCat("  ", Describe(unit.unit), " ", unit.attempt.value(), " ", unit.worker, " ", unit.file,
                      " ", unit.offset, " ", unit.length, " ", unit.samples, " ", unit.bad_samples, "\n");
}

std::string TextOf(JobStore& store, const JobId& job) {
  const absl::StatusOr<JobRecord> record = store.GetJob(job);
  if (!record.ok()) return absl::StrCat(job.value(), " ", CodeOf(record.status()), "\n");
  std::string text = TextOf(*record);
  const absl::Status status =
      store.ForEachUnit(job, std::nullopt, [&text](const UnitRecord& unit) { text += TextOf(unit); });
  const absl::StatusOr<std::vector<int32_t>> frames = store.FinishedFrames(job);
  absl::StatusOr<std::vector<std::string>> deliverers = store.DeliverersOf(job);
  if (deliverers.ok()) std::sort(deliverers->begin(), deliverers->end());
  absl::StrAppend(&text, "  ", CodeOf(status), " finished ",
                  frames.ok() ? absl::StrJoin(*frames, ",") : CodeOf(frames.status()), " by ",
                  deliverers.ok() ? absl::StrJoin(*deliverers, ",") : CodeOf(deliverers.status()), "\n");
  return text;
}

/// The spec with the files of the recorded one, which nothing changes.
v1::JobSpec WithFilesOf(JobStore& store, const JobId& job, v1::JobSpec spec) {
  const absl::StatusOr<JobRecord> record = store.GetJob(job);
  if (record.ok()) *spec.mutable_scene()->mutable_dependencies() = record->spec.scene().dependencies();
  return spec;
}

class Generator {
 public:
  explicit Generator(uint64_t seed) : random_(seed) {}

  Step Next() {
    const int kind = Below(100);
    if (kind < 40) return CommitStep();
    if (kind < 50) return CreateStep();
    if (kind < 57) return FrameStep();
    if (kind < 60) return KeptStep();
    if (kind < 66) return RevokeStep();
    if (kind < 72) return EndStep();
    if (kind < 78) return ReopenStep();
    if (kind < 82) return ClaimStep();
    if (kind < 84) return SchedulingStep();
    if (kind < 85) return PlanStep();
    if (kind < 86) return FindStep();
    if (kind < 90) return DeleteStep();
    if (kind < 95) return PurgeStep();
    return BlockStep();
  }

 private:
  int Below(int n) { return static_cast<int>(random_() % static_cast<uint64_t>(n)); }
  std::string AnyJob() { return absl::StrCat("j-", Below(4)); }
  /// Mostly 1: other owners must be refused.
  int64_t AnyEpoch() { return Below(6) == 0 ? 1 + Below(3) : epoch_; }

  NewJob AnyNewJob() {
    NewJob job = Job(AnyJob(), absl::StrCat("r-", Below(6)));
    if (Below(4) == 0) job.spec = FilledMessage<v1::JobSpec>(100);
    if (Below(4) == 0) job.scheduling = FilledMessage<v1::Scheduling>(100);
    job.scheduling.set_user(Below(2) == 0 ? "ann" : "ben");
    job.submitted = kStart + absl::Milliseconds(Below(1000));
    job.owner = {"owner", Epoch(epoch_)};
    return job;
  }

  JobCommit AnyCommit() {
    JobCommit commit = Commit(AnyJob(), {}, AnyEpoch());
    commit.numeric_class = Below(2) == 0 ? "avx2" : "sse2";
    commit.started = kStart + absl::Milliseconds(Below(1000));
    commit.recovered = Below(4) == 0;
    const int count = Below(4);
    for (int i = 0; i < count; ++i) {
      UnitRecord unit = Unit(commit.job.job.value(), Below(3), Below(4), Below(2),
                             Below(4) == 0 ? v1::UNIT_KIND_GEOMETRY : v1::UNIT_KIND_PASS);
      const Epoch epoch = Below(12) == 0 ? Epoch(1 + Below(3)) : commit.job.epoch;
      unit.attempt = job::Attempt(FirstAttempt(epoch).value() + Below(2));
      unit.worker = Below(5) == 0 ? "" : absl::StrCat("worker-", Below(3));
      unit.samples = Below(1000);
      unit.bad_samples = Below(3);
      unit.length = static_cast<uint64_t>(70 + Below(2));
      if (Below(2) == 0) unit.cost = {kStart + absl::Hours(12 * Below(4)), 0.25 * Below(9)};
      commit.units.push_back(unit);
    }
    for (int i = Below(3); i > 0; --i) commit.warnings.push_back(absl::StrCat("warning ", Below(130)));
    return commit;
  }

  Step CommitStep() {
    std::vector<JobCommit> commits;
    for (int i = 1 + Below(3); i > 0; --i) commits.push_back(AnyCommit());
    return {"commit", [commits](JobStore& store) -> absl::StatusOr<std::string> {
              const absl::StatusOr<std::vector<absl::Status>> outcomes = store.CommitUnits(commits);
              if (!outcomes.ok()) return outcomes.status();
              return absl::StrJoin(*outcomes, " ",
                                   [](std::string* out, const absl::Status& s) { *out += CodeOf(s); });
            }};
  }
  Step CreateStep() {
    return {"create", [job = AnyNewJob()](JobStore& store) -> absl::StatusOr<std::string> {
              const absl::StatusOr<JobId> id = store.CreateJob(job);
              return id.ok() ? id->value() : Outcome(id.status());
            }};
  }
  Step FrameStep() {
    v1::FrameReport report;
    report.mutable_times()->set_render_seconds(Below(5));
    report.mutable_times()->set_assemble_seconds(Below(5));
    report.mutable_times()->set_filter_seconds(Below(5));
    report.mutable_times()->set_write_seconds(Below(5));
    report.set_core_seconds(0.25 * Below(9));
    if (Below(2) == 0) report.set_finished_unix_ms(absl::ToUnixMillis(kStart + absl::Hours(12 * Below(4))));
    if (Below(2) == 0) report.set_estimated_error(Below(100));
    return {"frame", [job = Owned(AnyJob(), AnyEpoch()), frame = Below(3), report](JobStore& store) {
              return Outcome(store.RecordFrame(job, frame, report));
            }};
  }
  Step KeptStep() {
    JobCommit units = AnyCommit();
    const int32_t frame = Below(3);
    std::map<job::UnitKey, UnitRecord> of_frame;
    for (UnitRecord& unit : units.units) {
      unit.unit.key.frame = frame;
      of_frame.emplace(unit.unit.key, unit);
    }
    units.units.clear();
    for (const auto& [key, unit] : of_frame) units.units.push_back(unit);
    v1::FrameReport report;
    report.mutable_times()->set_filter_seconds(Below(5));
    return {"kept", [units, frame, report](JobStore& store) {
              return Outcome(store.RecordKeptFrame(units, frame, report));
            }};
  }
  Step RevokeStep() {
    std::vector<job::UnitKey> keys;
    for (int i = Below(4); i > 0; --i) keys.push_back({Below(3), Below(4), Below(2), v1::UNIT_KIND_PASS});
    return {"revoke", [job = Owned(AnyJob(), AnyEpoch()), keys](JobStore& store) {
              return Outcome(store.RevokeUnits(job, keys));
            }};
  }
  Step EndStep() {
    const v1::JobState state = Below(2) == 0 ? v1::JOB_STATE_DONE : v1::JOB_STATE_FAILED;
    return {"end", [job = Owned(AnyJob(), AnyEpoch()), state](JobStore& store) {
              return Outcome(store.EndJob(job, {state, "ended"}));
            }};
  }
  Step ReopenStep() {
    std::vector<int32_t> frames;
    for (int i = Below(3); i > 0; --i) frames.push_back(Below(3));
    Reopening reopening = {.spec = Job("", "").spec, .scheduling = {}, .frames = std::move(frames)};
    reopening.spec.set_samples_per_pixel(Below(100));
    reopening.counted = job::Attempt(Below(100));
    reopening.scheduling.mutable_gaps()->set_skip_failed(Below(2) == 0);
    return {"reopen", [job = JobId(AnyJob()), owner = Owner{"reopener", Epoch(AnyEpoch())},
                       reopening](JobStore& store) {
              Reopening again = reopening;
              again.spec = WithFilesOf(store, job, reopening.spec);
              return Outcome(store.ReopenFrames(job, owner, again));
            }};
  }
  Step ClaimStep() {
    if (Below(2) == 0 && epoch_ < 6) ++epoch_;
    return {"claim",
            [owner = Owner{"claimer", Epoch(AnyEpoch())}](JobStore& store) -> absl::StatusOr<std::string> {
              const absl::StatusOr<ClaimedJobs> claimed = store.ClaimUnfinishedJobs(owner);
              if (!claimed.ok()) return Outcome(claimed.status());
              std::string text;
              for (const JobRecord& job : claimed->jobs) text += TextOf(job);
              return text;
            }};
  }
  Step SchedulingStep() {
    v1::Scheduling scheduling;
    scheduling.set_user(Below(2) == 0 ? "ann" : "ben");
    scheduling.set_priority(Below(10));
    return {"scheduling", [job = Owned(AnyJob(), AnyEpoch()), scheduling](JobStore& store) {
              return Outcome(store.SetScheduling(job, scheduling));
            }};
  }
  Step PlanStep() {
    return {
        "plan", [job = Owned(AnyJob(), AnyEpoch()), first = 200 + Below(2)](JobStore& store) {
          return Outcome(store.SetPlan(job, WithFilesOf(store, job.job, FilledMessage<v1::JobSpec>(first))));
        }};
  }
  Step FindStep() {
    return {"find", [job = AnyNewJob()](JobStore& store) -> absl::StatusOr<std::string> {
              const absl::StatusOr<std::optional<JobId>> found = store.FindRequest(job);
              return found.ok() ? found->value_or(JobId("none")).value() : Outcome(found.status());
            }};
  }
  Step DeleteStep() {
    return {"delete", [job = JobId(AnyJob())](JobStore& store) { return Outcome(store.DeleteJob(job)); }};
  }
  Step PurgeStep() {
    return {"purge", [rows = 1 + Below(5)](JobStore& store) -> absl::StatusOr<std::string> {
              const absl::StatusOr<int64_t> left = store.PurgeUnits(rows);
              if (!left.ok()) return left.status();
              return absl::StrCat(*left);
            }};
  }
  Step BlockStep() {
    const std::string worker = absl::StrCat("worker-", Below(3));
    if (Below(2) == 0)
      return {"block", [worker](JobStore& s) { return Outcome(s.BlockWorker(worker, "bad")); }};
    return {"readmit", [worker](JobStore& s) { return Outcome(s.ReadmitWorker(worker)); }};
  }

  std::mt19937_64 random_;
  int64_t epoch_ = 1;
};

Step CommitOf(std::vector<JobCommit> commits) {
  return {"commit", [commits = std::move(commits)](JobStore& store) -> absl::StatusOr<std::string> {
            const absl::StatusOr<std::vector<absl::Status>> outcomes = store.CommitUnits(commits);
            if (!outcomes.ok()) return outcomes.status();
            return absl::StrJoin(*outcomes, " ",
                                 [](std::string* out, const absl::Status& s) { *out += CodeOf(s); });
          }};
}

}  // namespace

std::vector<Step> RandomHistory(uint64_t seed, int steps) {
  Generator generator(seed);
  std::vector<Step> history;
  for (int i = 0; i < steps; ++i) history.push_back(generator.Next());
  return history;
}

std::vector<Step> ShortHistory() {
  const auto create = [](const char* id) {
    return Step{"create", [id](JobStore& s) { return Outcome(s.CreateJob(Job(id, id)).status()); }};
  };
  JobCommit warned = Commit("j-b", {Unit("j-b", 0, 0, 0), Unit("j-b", 1, 0, 0)});
  warned.warnings = {"no light"};
  return {
      create("j-a"),
      create("j-b"),
      CommitOf({Commit("j-a", {Unit("j-a", 0, 0, 0), Unit("j-a", 0, 1, 0)}), warned}),
      CommitOf({Commit("j-a", {Unit("j-a", 0, 2, 0)}), Commit("j-b", {Unit("j-b", 1, 1, 0)})}),
      {"frame", [](JobStore& s) { return Outcome(s.RecordFrame(Owned("j-a"), 0, {})); }},
      {"purge", [](JobStore& s) { return Outcome(s.PurgeUnits(2).status()); }},
      {"revoke",
       [](JobStore& s) { return Outcome(s.RevokeUnits(Owned("j-b"), {Unit("j-b", 1, 1, 0).unit.key})); }},
      {"end", [](JobStore& s) { return Outcome(s.EndJob(Owned("j-a"), {v1::JOB_STATE_DONE, ""})); }},
      {"claim", [](JobStore& s) { return Outcome(s.ClaimUnfinishedJobs({"second", Epoch(2)}).status()); }},
      {"reopen",
       [](JobStore& s) {
         return Outcome(s.ReopenFrames(JobId("j-a"), {"second", Epoch(2)},
                                       {.spec = Job("", "").spec, .scheduling = {}, .frames = {0}}));
       }},
      {"end", [](JobStore& s) { return Outcome(s.EndJob(Owned("j-b", 2), {v1::JOB_STATE_CANCELLED, ""})); }},
      {"delete", [](JobStore& s) { return Outcome(s.DeleteJob(JobId("j-b"))); }},
      {"block", [](JobStore& s) { return Outcome(s.BlockWorker("w", "bad")); }},
      {"purge", [](JobStore& s) { return Outcome(s.PurgeUnits(100).status()); }},
  };
}

std::string Dump(JobStore& store) {
  std::string text;
  JobFilter filter = {.limit = 3};
  do {
    const absl::StatusOr<JobPage> page = store.ListJobs(filter);
    if (!page.ok()) return absl::StrCat("list: ", CodeOf(page.status()), " ", page.status().message());
    for (const JobRecord& job : page->jobs) text += TextOf(store, job.id);
    for (const DamagedJob& job : page->damaged) absl::StrAppend(&text, job.id.value(), " damaged\n");
    filter.before = page->next;
  } while (filter.before.has_value());
  for (const char* user : {"ann", "ben"}) {
    const absl::StatusOr<JobPage> page =
        store.ListJobs({.states = {v1::JOB_STATE_SUBMITTED, v1::JOB_STATE_FAILED}, .user = user});
    if (!page.ok()) return absl::StrCat("list: ", CodeOf(page.status()));
    for (const JobRecord& job : page->jobs) absl::StrAppend(&text, user, " has ", job.id.value(), "\n");
  }
  for (int day = 0; day < 3; ++day) {
    const absl::Time since = kStart + absl::Hours(24 * day);
    for (const char* user : {"", "ann"}) {
      const absl::StatusOr<std::vector<JobUsage>> usage =
          store.Usage({.since = since, .until = since + absl::Hours(24), .user = user});
      if (!usage.ok()) return absl::StrCat("usage: ", CodeOf(usage.status()));
      for (const JobUsage& of_job : *usage)
        absl::StrAppend(&text, day, user, " ", of_job.job.value(), " ", of_job.user, " ", of_job.work.units,
                        " ", of_job.work.render_seconds, " ", of_job.work.frames, " ",
                        of_job.work.finish_seconds, "\n");
    }
  }
  const absl::StatusOr<std::vector<BlockedWorker>> blocked = store.BlockedWorkers();
  if (!blocked.ok()) return absl::StrCat("blocked: ", CodeOf(blocked.status()));
  for (const BlockedWorker& worker : *blocked) absl::StrAppend(&text, worker.name, " ", worker.reason, "\n");
  return text;
}

}  // namespace lumifold::ledger
