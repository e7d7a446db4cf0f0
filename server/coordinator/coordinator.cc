#include "server/coordinator/coordinator.h"

#include <spdlog/logger.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "proto/logging/fields.h"
#include "proto/rpc/bounded_text.h"
#include "server/coordinator/job_status.h"

namespace lumifold::server {

using job::Attempt;
using job::JobId;
using job::UnitRef;
using job::WorkerId;

namespace {

/// Units of a frame may be lost this often before its job fails: a disk that loses them each time is broken.
constexpr int kMaxLosses = 3;

JanitorOptions JanitorOptionsOf(const CoordinatorOptions& options, const DataFolder& folder) {
  JanitorOptions janitor{.limits = options.retention,
                         .now = options.now,
                         .wall_now = options.wall_now,
                         .disk = [root = folder.root()] { return DiskSpaceOf(root); },
                         .log = options.log};
  janitor.limits.free_bytes = janitor.disk().kept_bytes;
  return janitor;
}

/// Host, process and a random number.
std::string OwnerName(uint64_t random) {
  std::array<char, 256> host = {};
  if (gethostname(host.data(), host.size() - 1) != 0) host = {'?'};
  return absl::StrFormat("%s:%d:%016x", host.data(), getpid(), random);
}

}  // namespace

absl::StatusOr<std::unique_ptr<Coordinator>> Coordinator::Create(const CoordinatorOptions& options,
                                                                 const DataFolder& folder,
                                                                 ledger::JobStore* store, AssetStore* assets,
                                                                 FrameFinisher* finisher) {
  const absl::StatusOr<ledger::Epoch> epoch = store->NewEpoch();
  if (!epoch.ok()) return epoch.status();
  std::unique_ptr<Coordinator> coordinator(new Coordinator(
      options, options.is_member ? folder.WithLogsOf(absl::StrCat("e", epoch->value())) : folder, store,
      assets, finisher, {OwnerName(options.random()), *epoch}));
  if (absl::Status status = coordinator->RestoreBlockedWorkers(); !status.ok()) return status;
  if (!options.is_member) {
    if (absl::Status status = coordinator->Restore(); !status.ok()) return status;
  }
  Coordinator* self = coordinator.get();
  assets->SetRoom([self] { return self->janitor_.Room(); });
  self->committer_->Start();
  self->janitor_.Start();
  self->finisher_thread_ = std::thread([self] { self->RunFinisher(); });
  self->housekeeping_thread_ = std::thread([self] { self->RunHousekeeping(); });
  return coordinator;
}

Coordinator::Coordinator(const CoordinatorOptions& options, const DataFolder& folder, ledger::JobStore* store,
                         AssetStore* assets, FrameFinisher* finisher, ledger::Owner owner)
    : options_(options),
      folder_(folder),
      store_(store),
      assets_(assets),
      finisher_(finisher),
      owner_(std::move(owner)),
      storage_(options.wall_now, options.log),
      scheduler_({.lease = options.lease, .first_attempt = ledger::FirstAttempt(owner_.epoch)}),
      janitor_(JanitorOptionsOf(options, folder), folder_, store_, assets_, &purger_, &deleter_),
      committer_(std::make_unique<Committer>(CommitterOptions{.epoch = owner_.epoch,
                                                              .now = options.now,
                                                              .first_pause = options.first_storage_pause,
                                                              .longest_pause = options.longest_storage_pause,
                                                              .max_open_logs = options.max_open_logs,
                                                              .reserve_bytes = options.reserve_bytes},
                                             folder_, store_, &storage_, &timings_,
                                             static_cast<Committer::Listener*>(this))) {
  storage_.OnChange(options.on_storage_change);
  absl::MutexLock lock(&mutex_);
  frame_resources_ = {.open_logs = options.max_open_logs,
                      .free_disk_bytes = folder.FreeBytes().value_or(0),
                      .memory_bytes = MemoryBytes()};
}

Coordinator::~Coordinator() { Shutdown(); }

void Coordinator::StopLeasing() {
  std::vector<JobId> ending;
  std::map<int64_t, StatusAnswer> changes;
  {
    absl::MutexLock lock(&mutex_);
    leasing_ = false;
    changes = std::exchange(changes_, {});
    for (const auto& [job, entry] : ending_jobs_) ending.push_back(job);
  }
  for (const JobId& job : ending)
    AnswerCancels(job, absl::UnavailableError("the coordinator is stopping; the job is not yet cancelled"));
  for (const auto& [number, done] : changes)
    done(absl::UnavailableError("the coordinator is stopping; the job may not be changed yet"));
}

void Coordinator::Shutdown() {
  StopLeasing();
  {
    absl::MutexLock lock(&mutex_);
    stopping_ = true;
  }
  housekeeping_.Notify();
  finishing_.Notify();
  changing_.Notify();
  adopting_.Notify();
  finisher_->Cancel();
  if (finisher_thread_.joinable()) finisher_thread_.join();
  committer_->Stop();
  if (housekeeping_thread_.joinable()) housekeeping_thread_.join();
  changer_.Stop();
  farm_thread_.Stop();
  deleter_.Stop();
  purger_.Stop();
}

bool Coordinator::IsWanted(const JobId& job) {
  absl::MutexLock lock(&mutex_);
  return active_jobs_.contains(job);
}

void Coordinator::OnCommitted(const std::vector<AcceptedUnit>& units, const absl::Status& status) {
  absl::MutexLock lock(&mutex_);
  if (!status.ok()) {
    const std::string error = absl::StrCat("units cannot be committed: ", std::string(status.message()));
    EndJob(units.front().stored.unit.job, v1::JOB_STATE_FAILED, error);
    return;
  }
  for (const AcceptedUnit& unit : units) {
    CountCommitted(unit);
    Acknowledge(unit.worker, unit.stored.unit, unit.stored.attempt);
  }
  GrantLeases();
}

void Coordinator::OnStorageAvailable() {
  absl::MutexLock lock(&mutex_);
  finishing_.Notify();
  GrantLeases();
}

absl::Status Coordinator::NoteError(const absl::Status& status) {
  if (!absl::IsUnavailable(status)) return status;
  storage_.Fail(status);
  return absl::ResourceExhaustedError(
      absl::StrCat("the coordinator cannot write to its storage: ", std::string(status.message())));
}

void Coordinator::OnUnitsLost(const JobId& job, int32_t frame, const absl::Status& cause,
                              const absl::StatusOr<std::vector<ledger::UnitRecord>>& lost) {
  absl::MutexLock lock(&mutex_);
  const auto active = active_jobs_.find(job);
  if (active == active_jobs_.end()) return;
  const std::string error(cause.message());
  if (!lost.ok()) return EndJob(job, v1::JOB_STATE_FAILED, std::string(lost.status().message()));
  if (lost->empty()) return EndJob(job, v1::JOB_STATE_FAILED, error);
  if (++losses_[{job, frame}] > kMaxLosses) {
    return EndJob(job, v1::JOB_STATE_FAILED,
                  absl::StrCat("units of frame ", frame, " were lost ", kMaxLosses + 1, " times: ", error));
  }
  for (const ledger::UnitRecord& record : *lost) {
    scheduler_.RevokeUnit(record.unit);
    active->second.bad_samples -= record.bad_samples;
  }
  options_.log->error("event=units_lost job={} frame={} units={} error={}", job.value(), frame, lost->size(),
                      logging::Quoted(error));
  changed_jobs_.insert(job);
  housekeeping_.Notify();
  GrantLeases();
}

void Coordinator::CountCommitted(const AcceptedUnit& unit) {
  ++units_committed_;
  samples_committed_ += unit.samples;
  const UnitRef& ref = unit.stored.unit;
  const auto active = active_jobs_.find(ref.job);
  if (active == active_jobs_.end()) {  // the job ended while the unit was being committed
    const auto ending = ending_jobs_.find(ref.job);
    if (ending == ending_jobs_.end()) return;
    ++ending->second.record.units_done;
    ending->second.record.samples_done += unit.samples;
    return;
  }
  ledger::JobRecord& record = active->second;
  record.bad_samples += unit.stored.stats.bad_samples();
  UnitBytes& bytes = unit_bytes_[ref.job];
  bytes.bytes += unit.record_bytes;
  ++bytes.units;
  record.times.set_render_seconds(absl::ToDoubleSeconds(options_.now() - render_starts_.at(ref.job)));
  for (const std::string& line : unit.stored.stats.warnings()) AddWarning(line, &record);
  options_.log->debug("event=unit_committed unit={} worker={} seconds={:.3f}", logging::Quoted(Describe(ref)),
                      NameOf(unit.worker), unit.stored.stats.seconds());
  if (scheduler_.UnitCommitted(ref)) {
    options_.log->info("event=frame_committed job={} frame={}", ref.job.value(), ref.key.frame);
  }
  QueueDue({ref.job, ref.key.frame});
  changed_jobs_.insert(ref.job);
  housekeeping_.Notify();
}

std::string Coordinator::NameOf(WorkerId worker) const {
  const auto found = workers_.find(worker);
  const std::string id = job::TextOf(worker);
  return found == workers_.end() ? id : absl::StrCat(id, "/", found->second.name);
}

}  // namespace lumifold::server
