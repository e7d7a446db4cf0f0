#include "tests/unit/ledger/memory_job_store.h"

#include <algorithm>
#include <cstdlib>
#include <map>
#include <set>
#include <tuple>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/job/limits.h"
#include "server/ledger/sql_usage.h"

namespace lumifold::ledger {
namespace {

using job::JobId;

struct UnitOrder {
  bool operator()(const job::UnitKey& a, const job::UnitKey& b) const {
    return std::tie(a.frame, a.tile, a.kind, a.pass) < std::tie(b.frame, b.tile, b.kind, b.pass);
  }
};

struct Frame {
  bool is_finished = false;
  std::map<job::UnitKey, UnitRecord, UnitOrder> units;  // also those of a finished frame, for the counts
};

struct StoredJob {
  int64_t number = 0;
  std::string request_id;
  std::string request;
  JobRecord record;
  std::map<int32_t, Frame> frames;
  std::set<std::string> deliverers;
};

}  // namespace

struct MemoryState {
  Epoch epoch;
  int64_t next = 0;
  std::map<int64_t, StoredJob> jobs;  // by the negative of the number: newest first
  std::map<std::string, std::string> blocked;
  int64_t garbage = 0;                                        // rows that PurgeUnits may delete
  std::map<std::pair<int64_t, std::string>, JobUsage> usage;  // by day and job
};

namespace {

bool HasNul(const std::string& text) { return text.find('\0') != std::string::npos; }

absl::Status Nul() { return absl::InvalidArgumentError("r\\000x has a NUL character"); }

std::string RequestOf(const NewJob& job) {
  v1::Scheduling scheduling = job.scheduling;
  scheduling.clear_trace_id();  // of the call, not of the request
  return job.spec.SerializeAsString() + "|" + scheduling.SerializeAsString();
}

class MemoryJobStore final : public JobStore {
 public:
  explicit MemoryJobStore(std::shared_ptr<MemoryState> state) : state_(std::move(state)) {}

  absl::StatusOr<Epoch> NewEpoch(Epoch floor) override {
    epoch_ = Epoch(std::max(epoch_, floor).value() + 1);
    return epoch_;
  }

  absl::StatusOr<JobId> CreateJob(const NewJob& job) override {
    const absl::StatusOr<std::optional<JobId>> recorded = FindRequest(job);
    if (!recorded.ok()) return recorded.status();
    if (recorded->has_value()) return **recorded;
    if (Find(job.id) != nullptr) return absl::AlreadyExistsError("the id is taken");
    StoredJob& stored = jobs_[--next_];
    stored.number = -next_;
    stored.request_id = job.request_id;
    stored.request = RequestOf(job);
    stored.record.id = job.id;
    stored.record.spec = job.spec;
    stored.record.scheduling = job.scheduling;
    stored.record.owner = job.owner;
    stored.record.submitted = job.submitted;
    return job.id;
  }

  absl::StatusOr<std::optional<JobId>> FindRequest(const NewJob& job) override {
    if (HasNul(job.request_id)) return Nul();
    for (const auto& [number, stored] : jobs_) {
      if (stored.request_id != job.request_id) continue;
      if (stored.request == RequestOf(job)) return stored.record.id;
      return absl::AlreadyExistsError(absl::StrCat(job.request_id, " is that of ", stored.record.id.value()));
    }
    return std::nullopt;
  }

  absl::StatusOr<ClaimedJobs> ClaimUnfinishedJobs(const Owner& owner) override {
    ClaimedJobs claimed;
    for (auto& [number, job] : jobs_) {
      if (IsActive(job) && job.record.owner.epoch > owner.epoch) return Lost(job, owner.epoch);
    }
    for (auto& [number, job] : jobs_) {
      if (!IsActive(job)) continue;
      job.record.owner = owner;
      claimed.jobs.insert(claimed.jobs.begin(), job.record);
    }
    return claimed;
  }

  absl::StatusOr<JobRecord> GetJob(const JobId& job) override {
    const StoredJob* stored = Find(job);
    if (stored == nullptr) return Unknown(job);
    return stored->record;
  }

  absl::StatusOr<JobPage> ListJobs(const JobFilter& filter) override {
    JobPage page;
    for (const auto& [negative, job] : jobs_) {  // newest first
      const auto& states = filter.states;
      if (filter.before.has_value() && job.number >= *filter.before) continue;
      if (!filter.user.empty() && job.record.scheduling.user() != filter.user) continue;
      if (!states.empty() && std::find(states.begin(), states.end(), job.record.state) == states.end())
        continue;
      if (page.jobs.size() == static_cast<size_t>(filter.limit)) {
        page.next = Find(page.jobs.back().id)->number;
        break;
      }
      JobRecord& record = page.jobs.emplace_back(job.record);
      record.warnings.clear();
      record.spec.mutable_scene()->clear_dependencies();
    }
    return page;
  }

  absl::StatusOr<std::vector<absl::Status>> CommitUnits(absl::Span<const JobCommit> commits) override {
    std::vector<absl::Status> outcomes;
    for (const JobCommit& commit : commits) outcomes.push_back(CommitJob(commit));
    return outcomes;
  }

  absl::Status RevokeUnits(const OwnedJob& owned, absl::Span<const job::UnitKey> units) override {
    StoredJob* job = Find(owned.job);
    if (absl::Status status = CheckOwned(owned, job); !status.ok()) return status;
    for (const job::UnitKey& key : units) {
      const auto frame = job->frames.find(key.frame);
      if (frame != job->frames.end() && !frame->second.is_finished) frame->second.units.erase(key);
    }
    Count(job);
    return absl::OkStatus();
  }

  absl::Status ForEachUnit(const JobId& id, std::optional<int32_t> wanted,
                           absl::FunctionRef<void(const UnitRecord&)> visit) override {
    const StoredJob* job = Find(id);
    if (job == nullptr) return Unknown(id);
    if (!IsActive(*job)) return absl::OkStatus();
    for (const auto& [number, frame] : job->frames) {
      if (frame.is_finished || wanted.value_or(number) != number) continue;
      for (const auto& [key, unit] : frame.units) visit(unit);
    }
    return absl::OkStatus();
  }

  absl::Status RecordKeptFrame(const JobCommit& units, int32_t number,
                               const v1::FrameReport& report) override {
    StoredJob* job = Find(units.job.job);
    if (absl::Status status = CheckOwned(units.job, job); !status.ok()) return status;
    if (const auto frame = job->frames.find(number); frame != job->frames.end()) {
      if (frame->second.is_finished) return absl::OkStatus();
      if (!frame->second.units.empty()) return absl::AlreadyExistsError("it has units");
    }
    if (absl::Status status = CommitJob(units); !status.ok()) return status;
    garbage_ -= static_cast<int64_t>(units.units.size());  // they have no rows
    return RecordFrame(units.job, number, report);
  }

  absl::Status RecordFrame(const OwnedJob& owned, int32_t number, const v1::FrameReport& report) override {
    StoredJob* job = Find(owned.job);
    if (absl::Status status = CheckOwned(owned, job); !status.ok()) return status;
    Frame& frame = job->frames[number];
    if (frame.is_finished) return absl::OkStatus();
    frame.is_finished = true;
    garbage_ += static_cast<int64_t>(frame.units.size());
    const v1::StageTimes& times = report.times();
    if (report.finished_unix_ms() > 0) {
      JobUsage& usage = UsageOf(*job, DayOf(absl::FromUnixMillis(report.finished_unix_ms())));
      ++usage.work.frames;
      usage.work.finish_seconds += report.core_seconds();
    }
    v1::StageTimes& sum = job->record.times;
    sum.set_render_seconds(std::max(sum.render_seconds(), times.render_seconds()));
    sum.set_assemble_seconds(sum.assemble_seconds() + times.assemble_seconds());
    sum.set_filter_seconds(sum.filter_seconds() + times.filter_seconds());
    sum.set_write_seconds(sum.write_seconds() + times.write_seconds());
    if (report.has_estimated_error()) job->record.NoteError(report.estimated_error());
    Count(job);
    return absl::OkStatus();
  }

  absl::StatusOr<std::vector<int32_t>> FinishedFrames(const JobId& id) override {
    const StoredJob* job = Find(id);
    if (job == nullptr) return Unknown(id);
    std::vector<int32_t> frames;
    for (const auto& [number, frame] : job->frames) {
      if (frame.is_finished) frames.push_back(number);
    }
    return frames;
  }

  absl::StatusOr<std::vector<std::string>> DeliverersOf(const JobId& id) override {
    const StoredJob* job = Find(id);
    if (job == nullptr) return Unknown(id);
    return std::vector<std::string>(job->deliverers.begin(), job->deliverers.end());
  }

  absl::Status EndJob(const OwnedJob& owned, const JobEnd& end) override {
    StoredJob* job = Find(owned.job);
    if (job == nullptr) return Unknown(owned.job);
    if (job->record.owner.epoch != owned.epoch) return Lost(*job, owned.epoch);
    if (!IsActive(*job)) return absl::OkStatus();
    for (const auto& [number, frame] : job->frames) {
      if (!frame.is_finished) garbage_ += static_cast<int64_t>(frame.units.size());
    }
    std::erase_if(job->frames, [](const auto& entry) { return !entry.second.is_finished; });
    job->record.state = end.state;
    job->record.error = end.error;
    return absl::OkStatus();
  }

  /// The model has none: nothing else of a store depends on them.
  DeliveryQueue& deliveries() override { std::abort(); }

  absl::Status ReopenFrames(const JobId& id, const Owner& owner, const Reopening& reopening) override {
    StoredJob* job = Find(id);
    if (job == nullptr) return Unknown(id);
    const Epoch epoch = job->record.owner.epoch;
    if (IsActive(*job) ? owner.epoch != epoch : owner.epoch < epoch) return Lost(*job, owner.epoch);
    for (const int32_t number : reopening.frames) {
      const auto frame = job->frames.find(number);
      if (frame == job->frames.end()) continue;
      if (!frame->second.is_finished) garbage_ += static_cast<int64_t>(frame->second.units.size());
      job->frames.erase(frame);
    }
    job->record.state = v1::JOB_STATE_SUBMITTED;
    job->record.error = "";
    job->record.owner = owner;
    job->record.spec = reopening.spec;
    job->record.scheduling = reopening.scheduling;
    job->record.counted = reopening.counted;
    Count(job);
    const bool is_bound = std::any_of(job->frames.begin(), job->frames.end(), [](const auto& entry) {
      return entry.second.is_finished || !entry.second.units.empty();
    });
    if (!is_bound) job->record.numeric_class = "";
    return absl::OkStatus();
  }

  absl::StatusOr<std::vector<JobUsage>> Usage(const UsageFilter& filter) override {
    std::map<std::pair<std::string, std::string>, JobUsage> sums;
    for (const auto& [key, of_day] : state_->usage) {
      if (key.first < DayOf(filter.since) || key.first >= DayOf(filter.until)) continue;
      if (!filter.user.empty() && of_day.user != filter.user) continue;
      JobUsage& sum = sums[{key.second, of_day.user}];
      sum.job = of_day.job;
      sum.user = of_day.user;
      sum.work.units += of_day.work.units;
      sum.work.render_seconds += of_day.work.render_seconds;
      sum.work.frames += of_day.work.frames;
      sum.work.finish_seconds += of_day.work.finish_seconds;
    }
    std::vector<JobUsage> usage;
    for (const auto& [key, sum] : sums) usage.push_back(sum);
    std::stable_sort(usage.begin(), usage.end(), [](const JobUsage& a, const JobUsage& b) {
      return a.work.render_seconds + a.work.finish_seconds > b.work.render_seconds + b.work.finish_seconds;
    });
    return usage;
  }

  absl::Status SetScheduling(const OwnedJob& owned, const v1::Scheduling& scheduling) override {
    StoredJob* job = Find(owned.job);
    if (absl::Status status = CheckOwned(owned, job); !status.ok()) return status;
    job->record.scheduling = scheduling;
    return absl::OkStatus();
  }

  absl::Status SetPlan(const OwnedJob& owned, const v1::JobSpec& planned) override {
    StoredJob* job = Find(owned.job);
    if (absl::Status status = CheckOwned(owned, job); !status.ok()) return status;
    job->record.spec = planned;
    return absl::OkStatus();
  }

  absl::Status DeleteJob(const JobId& id) override {
    const StoredJob* job = Find(id);
    if (job == nullptr) return Unknown(id);
    if (IsActive(*job)) return absl::FailedPreconditionError("the job has not ended");
    std::erase_if(jobs_, [&id](const auto& entry) { return entry.second.record.id == id; });
    return absl::OkStatus();
  }

  absl::StatusOr<int64_t> PurgeUnits(int64_t max_rows) override {
    garbage_ = std::max<int64_t>(0, garbage_ - max_rows);
    return garbage_;
  }

  absl::Status BlockWorker(const std::string& name, const std::string& reason) override {
    blocked_[name] = reason;
    return absl::OkStatus();
  }
  absl::Status ReadmitWorker(const std::string& name) override {
    if (blocked_.erase(name) == 1) return absl::OkStatus();
    return absl::NotFoundError(absl::StrCat("worker '", name, "' is not blocked"));
  }
  absl::StatusOr<std::vector<BlockedWorker>> BlockedWorkers() override {
    std::vector<BlockedWorker> workers;
    for (const auto& [name, reason] : blocked_) workers.push_back({name, reason});
    return workers;
  }

 private:
  StoredJob* Find(const JobId& id) {
    for (auto& [number, job] : jobs_) {
      if (job.record.id == id) return &job;
    }
    return nullptr;
  }
  static bool IsActive(const StoredJob& job) { return job.record.state == v1::JOB_STATE_SUBMITTED; }
  static absl::Status Unknown(const JobId& id) {
    return absl::NotFoundError(absl::StrCat("no job ", id.value()));
  }
  static absl::Status Lost(const StoredJob& job, Epoch caller) {
    return absl::AbortedError(
        absl::StrCat("epoch ", job.record.owner.epoch.value(), " owns the job, not epoch ", caller.value()));
  }
  static absl::Status CheckOwned(const OwnedJob& owned, const StoredJob* job) {
    if (job == nullptr) return Unknown(owned.job);
    if (job->record.owner.epoch != owned.epoch) return Lost(*job, owned.epoch);
    if (!IsActive(*job)) return absl::FailedPreconditionError("the job has ended");
    return absl::OkStatus();
  }

  /// Sets the counts of an active job.
  static void Count(StoredJob* job) {
    JobRecord& record = job->record;
    record.done = {};
    for (const auto& [number, frame] : job->frames) {
      record.done.frames += frame.is_finished ? 1 : 0;
      for (const auto& [key, unit] : frame.units) {
        ++record.done.units;
        record.done.samples += unit.samples;
        record.done.bad_samples += unit.bad_samples;
      }
    }
  }

  static void AddWarnings(const std::vector<std::string>& lines, JobRecord* record) {
    for (const std::string& line : lines) {
      if (std::find(record->warnings.begin(), record->warnings.end(), line) != record->warnings.end())
        continue;
      if (record->warnings.size() < size_t{job::kMaxJobWarnings}) {
        record->warnings.push_back(line);
      } else {
        ++record->warnings_left_out;
      }
    }
  }

  JobUsage& UsageOf(const StoredJob& job, int64_t day) {
    // The user of the day's first work stays.
    const JobUsage of_new = {job.record.id, job.record.scheduling.user(), {}};
    return state_->usage.try_emplace({day, job.record.id.value()}, of_new).first->second;
  }

  absl::Status CommitJob(const JobCommit& commit) {
    StoredJob* job = Find(commit.job.job);
    if (absl::Status status = CheckOwned(commit.job, job); !status.ok()) return status;
    for (const UnitRecord& unit : commit.units) {
      const Epoch epoch = EpochOf(unit.attempt);
      if (epoch == commit.job.epoch || commit.recovered) continue;
      return absl::AbortedError(absl::StrCat(Describe(unit.unit), ": epoch ", epoch.value(), ", not epoch ",
                                             commit.job.epoch.value()));
    }
    std::map<job::UnitKey, UnitRecord> units;
    for (const UnitRecord& unit : commit.units) {
      const auto frame = job->frames.find(unit.unit.key.frame);
      const bool is_finished = frame != job->frames.end() && frame->second.is_finished;
      const UnitRecord* known = nullptr;
      if (frame != job->frames.end() && frame->second.units.contains(unit.unit.key))
        known = &frame->second.units.at(unit.unit.key);
      const bool is_same = known != nullptr && known->attempt == unit.attempt && known->file == unit.file &&
                           known->offset == unit.offset && known->length == unit.length;
      if (!is_finished && is_same) continue;
      if (is_finished || known != nullptr || !units.emplace(unit.unit.key, unit).second)
        return absl::AlreadyExistsError(Describe(unit.unit));
    }
    for (const auto& [key, unit] : units) {
      if (!unit.worker.empty()) job->deliverers.insert(unit.worker);
      job->frames[key.frame].units.emplace(key, unit);
      if (!unit.cost.has_value()) continue;
      JobUsage& usage = UsageOf(*job, DayOf(unit.cost->at));
      ++usage.work.units;
      usage.work.render_seconds += unit.cost->seconds;
    }
    Count(job);
    if (job->record.numeric_class.empty()) {
      job->record.numeric_class = commit.numeric_class;
      job->record.started = commit.started;
    }
    AddWarnings(commit.warnings, &job->record);
    return absl::OkStatus();
  }

  const std::shared_ptr<MemoryState> state_;
  Epoch& epoch_ = state_->epoch;
  int64_t& next_ = state_->next;
  std::map<int64_t, StoredJob>& jobs_ = state_->jobs;
  std::map<std::string, std::string>& blocked_ = state_->blocked;
  int64_t& garbage_ = state_->garbage;
};

}  // namespace

std::shared_ptr<MemoryState> MakeMemoryState() { return std::make_shared<MemoryState>(); }

std::unique_ptr<JobStore> MakeMemoryJobStore(std::shared_ptr<MemoryState> state) {
  return std::make_unique<MemoryJobStore>(std::move(state));
}

}  // namespace lumifold::ledger
