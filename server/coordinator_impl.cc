#include "server/coordinator_impl.h"

#include <spdlog/logger.h>

#include <algorithm>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "filter/methods.h"
#include "proto/rpc/bounded_text.h"
#include "proto/rpc/limits.h"
#include "proto/rpc/sha256.h"
#include "proto/rpc/version.h"
#include "server/film/result_digest.h"
#include "server/job/ids.h"
#include "server/job/job_spec.h"
#include "server/job/limits.h"
#include "server/job_status.h"

namespace lumifold::server {
namespace {

using job::Attempt;
using job::JobId;
using job::UnitRef;
using job::WorkerId;

constexpr int kMaxSlots = 1024;
constexpr int kDefaultListed = 100;
constexpr int kMaxListed = 1000;
/// Units of a frame may be lost this often before its job fails: a disk that loses them each time is broken.
constexpr int kMaxLosses = 3;
constexpr size_t kMaxListedErrorBytes = 256;
constexpr int kMaxLeasesPerGrant = 256;
/// Bytes of a lease in a grant: its job's id and ten numbers.
constexpr size_t kMaxLeaseBytes = 256;
static_assert(job::kMaxSpecBytes + kMaxLeasesPerGrant * kMaxLeaseBytes < rpc::kMaxMessageBytes,
              "a grant with a spec fits a message");

v1::Lease ProtoFromLease(const scheduler::GrantedLease& lease) {
  v1::Lease proto;
  *proto.mutable_unit() = ProtoFromUnit(lease.unit);
  proto.set_attempt(lease.attempt.value());
  proto.mutable_rect()->set_x0(lease.rect.x0);
  proto.mutable_rect()->set_y0(lease.rect.y0);
  proto.mutable_rect()->set_x1(lease.rect.x1);
  proto.mutable_rect()->set_y1(lease.rect.y1);
  proto.set_first_sample(lease.samples.first);
  proto.set_last_sample(lease.samples.last);
  return proto;
}

absl::Status CheckMethod(const std::string& method) {
  const absl::Status status = filter::CheckMethod(method);
  return status.ok() ? status : absl::InvalidArgumentError(absl::StrCat("filter.method: ", status.message()));
}

/// Escapes text of clients and workers for one line of the log.
std::string Quoted(const std::string& text) {
  return absl::StrCat("\"", absl::Utf8SafeCEscape(rpc::BoundedLine(text, rpc::kMaxErrorBytes)), "\"");
}

absl::Status CheckHello(const v1::Hello& hello) {
  if (hello.name().size() > rpc::kMaxWorkerNameBytes ||
      hello.numeric_class().size() > rpc::kMaxWorkerNameBytes) {
    return absl::InvalidArgumentError(
        absl::StrCat("worker: its name has ", hello.name().size(), " bytes and its numeric_class ",
                     hello.numeric_class().size(), ", allowed are ", rpc::kMaxWorkerNameBytes));
  }
  if (hello.wire_version() != rpc::kWireVersion) {
    return absl::FailedPreconditionError(absl::StrCat("worker '", hello.name(), "' has wire version ",
                                                      hello.wire_version(), ", this coordinator ",
                                                      rpc::kWireVersion));
  }
  if (hello.numeric_class().empty() || hello.slots() < 1 || hello.slots() > kMaxSlots) {
    return absl::InvalidArgumentError(absl::StrCat(
        "worker '", hello.name(), "': numeric_class must not be empty and slots must be 1 to ", kMaxSlots));
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::unique_ptr<Coordinator>> Coordinator::Create(const CoordinatorOptions& options,
                                                                 const DataFolder& folder,
                                                                 ledger::JobStore* store, AssetStore* assets,
                                                                 FrameFinisher* finisher) {
  std::unique_ptr<Coordinator> coordinator(new Coordinator(options, folder, store, assets, finisher));
  if (absl::Status status = coordinator->Restore(); !status.ok()) return status;
  Coordinator* self = coordinator.get();
  self->finisher_thread_ = std::thread([self] { self->RunFinisher(); });
  self->housekeeping_thread_ = std::thread([self] { self->RunHousekeeping(); });
  return coordinator;
}

Coordinator::Coordinator(const CoordinatorOptions& options, const DataFolder& folder, ledger::JobStore* store,
                         AssetStore* assets, FrameFinisher* finisher)
    : options_(options),
      folder_(folder),
      store_(store),
      assets_(assets),
      finisher_(finisher),
      // The clock's microseconds are above any attempt that an earlier run of this coordinator granted.
      scheduler_({.lease = options.lease, .first_attempt = Attempt(absl::ToUnixMicros(options.now()))}),
      committer_(std::make_unique<Committer>(folder_, store_, static_cast<Committer::Listener*>(this))) {}

Coordinator::~Coordinator() { Shutdown(); }

void Coordinator::StopLeasing() {
  absl::MutexLock lock(&mutex_);
  leasing_ = false;
}

void Coordinator::Shutdown() {
  {
    absl::MutexLock lock(&mutex_);
    leasing_ = false;
    stopping_ = true;
    housekeeping_.SignalAll();
  }
  finisher_->Cancel();
  committer_->Stop();
  if (finisher_thread_.joinable()) finisher_thread_.join();
  if (housekeeping_thread_.joinable()) housekeeping_thread_.join();
}

absl::Status Coordinator::Restore() {
  const absl::StatusOr<std::vector<ledger::JobRecord>> jobs = store_->UnfinishedJobs();
  if (!jobs.ok()) return jobs.status();
  absl::MutexLock lock(&mutex_);
  for (const ledger::JobRecord& record : *jobs) {
    if (absl::Status status = RestoreJob(record); !status.ok()) return status;
  }
  return absl::OkStatus();
}

absl::Status Coordinator::RestoreJob(const ledger::JobRecord& record) {
  if (const absl::Status valid = job::NormaliseJobSpec(record.spec).status(); !valid.ok()) {
    // Recorded by a version with other limits. A grant could not carry it, so that no worker could stay connected.
    active_jobs_.emplace(record.id, record);
    EndJob(record.id, v1::JOB_STATE_FAILED,
           absl::StrCat("the job's spec is not valid: ", std::string(valid.message())));
    return absl::OkStatus();
  }
  scheduler_.AddJob(record.id, record.spec, record.numeric_class);
  active_jobs_.emplace(record.id, record);
  const absl::StatusOr<std::vector<int32_t>> finished = store_->FinishedFrames(record.id);
  if (!finished.ok()) return finished.status();
  for (const int32_t frame : *finished) scheduler_.RestoreFinishedFrame(record.id, frame);
  std::map<int32_t, uint64_t> committed_bytes;
  absl::Status read = store_->ForEachUnit(record.id, std::nullopt,
                                          [&](const ledger::UnitRecord& unit) ABSL_NO_THREAD_SAFETY_ANALYSIS {
                                            scheduler_.RestoreCommittedUnit(unit.unit);
                                            uint64_t& end = committed_bytes[unit.unit.key.frame];
                                            end = std::max(end, unit.offset + unit.length);
                                          });
  if (!read.ok()) return read;
  for (const auto& [frame, bytes] : committed_bytes) committer_->RestoreLog(record.id, frame, bytes);
  for (const int32_t frame : scheduler_.CommittedFrames(record.id))
    committed_frames_.push_back({record.id, frame});
  const scheduler::JobProgress progress = scheduler_.Progress(record.id);
  options_.log->info("event=job_restored job={} units={}/{} frames={}/{}", record.id.value(),
                     progress.units_done, progress.units_total, progress.frames_done, progress.frames_total);
  if (progress.frames_done == progress.frames_total) EndJob(record.id, v1::JOB_STATE_DONE, "");
  return absl::OkStatus();
}

absl::StatusOr<v1::FindMissingAssetsResponse> Coordinator::FindMissingAssets(
    const v1::FindMissingAssetsRequest& request) const {
  v1::FindMissingAssetsResponse response;
  std::set<std::string> seen;
  for (const v1::AssetRef& asset : request.assets()) {
    if (!rpc::IsSha256Hex(asset.sha256())) {
      return absl::InvalidArgumentError(
          absl::StrCat("asset '", asset.uri(), "': sha256 is not 64 lower-case hexadecimal digits"));
    }
    if (seen.insert(asset.sha256()).second && !assets_->Has(asset.sha256())) {
      response.add_missing_sha256(asset.sha256());
    }
  }
  return response;
}

absl::StatusOr<v1::FindUploadResponse> Coordinator::FindUpload(const v1::FindUploadRequest& request) const {
  v1::FindUploadResponse response;
  response.set_received_bytes(assets_->ReceivedBytes(request.asset().sha256()));
  return response;
}

absl::StatusOr<std::unique_ptr<AssetUpload>> Coordinator::ReceiveAsset(const v1::AssetRef& asset) {
  return assets_->Receive(asset);
}

absl::Status Coordinator::CheckSpec(const v1::JobSpec& spec) const {
  if (absl::Status status = CheckMethod(spec.filter().method()); !status.ok()) return status;
  std::vector<v1::AssetRef> assets(spec.scene().dependencies().begin(), spec.scene().dependencies().end());
  assets.insert(assets.begin(), spec.scene().file());
  for (const v1::AssetRef& asset : assets) {
    const std::string name = asset.uri().empty() ? "scene.file" : absl::StrCat("'", asset.uri(), "'");
    if (!rpc::IsSha256Hex(asset.sha256())) {
      return absl::InvalidArgumentError(
          absl::StrCat(name, ": sha256 is not 64 lower-case hexadecimal digits"));
    }
    if (!assets_->Has(asset.sha256())) {
      return absl::FailedPreconditionError(
          absl::StrCat("asset ", asset.sha256(), " (", name, ") is missing"));
    }
  }
  return absl::OkStatus();
}

absl::StatusOr<v1::SubmitJobResponse> Coordinator::SubmitJob(const v1::SubmitJobRequest& request) {
  if (request.request_id().empty() || request.request_id().size() > job::kMaxRequestIdBytes) {
    return absl::InvalidArgumentError(absl::StrCat("request_id has ", request.request_id().size(),
                                                   " bytes, not 1 to ", job::kMaxRequestIdBytes));
  }
  const absl::StatusOr<v1::JobSpec> spec = job::NormaliseJobSpec(request.spec());
  if (!spec.ok()) return spec.status();
  if (absl::Status status = CheckSpec(*spec); !status.ok()) return status;
  const absl::Time now = options_.now();
  const ledger::NewJob job{.id = job::MakeJobId(now, options_.random()),
                           .request_id = request.request_id(),
                           .spec = *spec,
                           .submitted = now};
  const absl::StatusOr<JobId> id = store_->CreateJob(job);
  if (!id.ok()) return id.status();
  if (*id == job.id) StartJob(job);  // otherwise the request was recorded before
  v1::SubmitJobResponse response;
  response.set_job_id(id->value());
  return response;
}

void Coordinator::StartJob(const ledger::NewJob& job) {
  ledger::JobRecord record;
  record.id = job.id;
  record.spec = job.spec;
  record.submitted = job.submitted;
  absl::MutexLock lock(&mutex_);
  scheduler_.AddJob(job.id, job.spec);
  active_jobs_.emplace(job.id, std::move(record));
  options_.log->info("event=job_submitted job={} scene={} size={}x{} spp={} frames={}", job.id.value(),
                     Quoted(job.spec.scene().display_name()), job.spec.width(), job.spec.height(),
                     job.spec.samples_per_pixel(), job.spec.frame_count());
  GrantLeases();
}

absl::StatusOr<v1::JobStatus> Coordinator::StatusOf(const JobId& job) {
  const auto active = active_jobs_.find(job);
  if (active != active_jobs_.end()) return StatusOfActiveJob(active->second, scheduler_.Progress(job));
  const absl::StatusOr<ledger::JobRecord> record = store_->GetJob(job);
  if (!record.ok()) return record.status();
  return StatusOfEndedJob(*record);
}

absl::StatusOr<v1::JobStatus> Coordinator::GetJob(const std::string& job_id) {
  absl::MutexLock lock(&mutex_);
  return StatusOf(JobId(job_id));
}

absl::StatusOr<v1::ListJobsResponse> Coordinator::ListJobs(const v1::ListJobsRequest& request) {
  const int limit = request.limit() == 0 ? kDefaultListed : request.limit();
  if (limit < 1 || limit > kMaxListed) {
    return absl::InvalidArgumentError(absl::StrCat("limit is ", request.limit(), ", not 0 to ", kMaxListed));
  }
  const absl::StatusOr<std::vector<ledger::JobRecord>> records = store_->ListJobs(limit);
  if (!records.ok()) return records.status();
  v1::ListJobsResponse response;
  absl::MutexLock lock(&mutex_);
  for (const ledger::JobRecord& record : *records) {
    absl::StatusOr<v1::JobStatus> status = StatusOf(record.id);
    if (!status.ok()) return status.status();
    // A thousand jobs must fit a message: their warnings and long errors are in GetJob.
    status->clear_warnings();
    status->set_error(rpc::BoundedLine(status->error(), kMaxListedErrorBytes));
    *response.add_jobs() = *std::move(status);
  }
  return response;
}

absl::StatusOr<v1::JobStatus> Coordinator::CancelJob(const std::string& job_id) {
  absl::MutexLock lock(&mutex_);
  const JobId job(job_id);
  if (active_jobs_.contains(job)) EndJob(job, v1::JOB_STATE_CANCELLED, "");
  return StatusOf(job);
}

absl::StatusOr<rpc::ByteSender> Coordinator::OpenResult(const v1::DownloadResultRequest& request) {
  const JobId job(request.job_id());
  const absl::StatusOr<ledger::JobRecord> record = store_->GetJob(job);
  if (!record.ok()) return record.status();
  const int64_t frame = int64_t{request.frame()} - record->spec.first_frame();
  if (frame < 0 || frame >= record->spec.frame_count()) {
    return absl::NotFoundError(absl::StrCat("job ", request.job_id(), " has no frame ", request.frame()));
  }
  const absl::StatusOr<std::vector<int32_t>> finished = store_->FinishedFrames(job);
  if (!finished.ok()) return finished.status();
  if (!std::binary_search(finished->begin(), finished->end(), request.frame())) {
    return absl::FailedPreconditionError(
        absl::StrCat("frame ", request.frame(), " of job ", request.job_id(), " is not ready"));
  }
  const std::string path = folder_.ResultPath(job, request.frame());
  absl::StatusOr<rpc::ByteSender> sender = rpc::ByteSender::Open(path, request.offset());
  if (!sender.ok()) return sender;
  absl::StatusOr<std::string> digest = film::ResultDigest(path);
  if (!digest.ok()) return digest.status();
  sender->SetSha256(*std::move(digest));
  return sender;
}

absl::Status Coordinator::Watch(const std::string& job_id, JobWatcher* watcher) {
  absl::MutexLock lock(&mutex_);
  const JobId job(job_id);
  const absl::StatusOr<v1::JobStatus> status = StatusOf(job);
  if (!status.ok()) return status.status();
  watchers_[watcher] = job;
  watcher->OnStatus(*status);
  return absl::OkStatus();
}

void Coordinator::Unwatch(JobWatcher* watcher) {
  absl::MutexLock lock(&mutex_);
  watchers_.erase(watcher);
}

absl::StatusOr<rpc::ByteSender> Coordinator::OpenAsset(const v1::FetchAssetRequest& request) const {
  return assets_->Open(request.sha256(), request.offset());
}

absl::StatusOr<WorkerId> Coordinator::AddWorker(const v1::Hello& hello, WorkerSink* sink) {
  if (absl::Status status = CheckHello(hello); !status.ok()) {
    options_.log->warn("event=worker_refused worker={} error={}", Quoted(hello.name()),
                       Quoted(std::string(status.message())));
    return status;
  }
  absl::MutexLock lock(&mutex_);
  if (stopping_) return absl::UnavailableError("the coordinator is stopping");
  const WorkerId worker(next_worker_++);
  scheduler_.AddWorker(worker, hello.numeric_class(), hello.slots(), absl::Utf8SafeCEscape(hello.name()));
  workers_.emplace(worker, ConnectedWorker{absl::Utf8SafeCEscape(hello.name()), sink, {}});
  v1::CoordinatorMessage welcome;
  welcome.mutable_welcome()->set_worker_id(absl::StrCat("w-", worker.value()));
  welcome.mutable_welcome()->set_heartbeat_ms(absl::ToInt64Milliseconds(options_.heartbeat));
  sink->Send(welcome);
  options_.log->info("event=worker_connected worker={} class={} slots={}", NameOf(worker),
                     Quoted(hello.numeric_class()), hello.slots());
  GrantLeases();
  return worker;
}

void Coordinator::RemoveWorker(WorkerId worker) {
  absl::MutexLock lock(&mutex_);
  options_.log->info("event=worker_gone worker={}", NameOf(worker));
  workers_.erase(worker);
  const std::vector<scheduler::FailedJob> failed = scheduler_.RemoveWorker(worker);
  if (!leasing_) return;
  for (const scheduler::FailedJob& job : failed) EndJob(job.job, v1::JOB_STATE_FAILED, job.error);
  for (const auto& [job, record] : active_jobs_) changed_jobs_.insert(job);
  GrantLeases();
}

void Coordinator::OnHeartbeat(WorkerId worker, const v1::Heartbeat& heartbeat) {
  std::vector<scheduler::HeldLease> held;
  for (const v1::Lease& lease : heartbeat.held()) {
    held.push_back({job::UnitFromProto(lease.unit()), Attempt(lease.attempt()), lease.progress()});
  }
  absl::MutexLock lock(&mutex_);
  scheduler_.Heartbeat(worker, held, Attempt(heartbeat.newest_attempt()), options_.now());
  GrantLeases();
}

std::optional<LeasedUnit> Coordinator::FindLease(WorkerId worker, const UnitRef& unit, Attempt attempt) {
  absl::MutexLock lock(&mutex_);
  if (!scheduler_.HoldsLease(worker, unit, attempt)) return std::nullopt;
  const job::FrameUnits& units = scheduler_.UnitsOf(unit.job);
  return LeasedUnit{units.tiles().RectOf(unit.key.tile), units.SamplesOf(unit.key)};
}

void Coordinator::Deliver(WorkerId worker, film::StoredUnit unit) {
  absl::MutexLock lock(&mutex_);
  const scheduler::Completion completion =
      scheduler_.CompleteUnit(worker, unit.unit, unit.attempt, options_.now());
  if (completion != scheduler::Completion::kAccepted) {
    options_.log->info("event=unit_not_wanted unit={} worker={}", Quoted(Describe(unit.unit)),
                       NameOf(worker));
    Acknowledge(worker, unit.unit, unit.attempt);
    return;
  }
  const JobId job = unit.unit.job;
  const int64_t samples = scheduler_.UnitsOf(job).CameraSamplesOf(unit.unit.key);
  committer_->Enqueue({.stored = std::move(unit),
                       .worker = worker,
                       .samples = samples,
                       .numeric_class = scheduler_.NumericClassOf(job),
                       .started = active_jobs_.at(job).started});
}

void Coordinator::Dismiss(WorkerId worker, const UnitRef& unit, Attempt attempt) {
  absl::MutexLock lock(&mutex_);
  options_.log->info("event=unit_not_wanted unit={} worker={}", Quoted(Describe(unit)), NameOf(worker));
  Acknowledge(worker, unit, attempt);
}

void Coordinator::RefuseUnit(WorkerId worker, const UnitRef& unit, Attempt attempt,
                             const std::string& reason) {
  std::string error;
  {
    absl::MutexLock lock(&mutex_);
    error = absl::StrCat("worker ", NameOf(worker), " delivered ", Describe(unit),
                         ", which is not valid: ", reason);
    Acknowledge(worker, unit, attempt, reason);
  }
  FailUnit(worker, unit, attempt, error, /*permanent=*/false);
}

void Coordinator::FailUnit(WorkerId worker, const UnitRef& unit, Attempt attempt, const std::string& error,
                           bool permanent) {
  absl::MutexLock lock(&mutex_);
  const scheduler::FailureOutcome outcome =
      scheduler_.FailUnit(worker, unit, attempt, permanent, options_.now());
  options_.log->warn("event=unit_failed unit={} worker={} permanent={} error={}", Quoted(Describe(unit)),
                     NameOf(worker), permanent, Quoted(error));
  if (outcome == scheduler::FailureOutcome::kJobFails) EndJob(unit.job, v1::JOB_STATE_FAILED, error);
  GrantLeases();
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
                      Quoted(error));
  changed_jobs_.insert(job);
  housekeeping_.Signal();
  GrantLeases();
}

void Coordinator::CountCommitted(const AcceptedUnit& unit) {
  const UnitRef& ref = unit.stored.unit;
  const auto active = active_jobs_.find(ref.job);
  if (active == active_jobs_.end()) return;  // the job ended while the unit was being committed
  ledger::JobRecord& record = active->second;
  record.bad_samples += unit.stored.stats.bad_samples();
  record.times.set_render_seconds(absl::ToDoubleSeconds(options_.now() - record.started));
  for (const std::string& line : unit.stored.stats.warnings()) AddWarning(line, &record);
  options_.log->debug("event=unit_committed unit={} worker={} seconds={:.3f}", Quoted(Describe(ref)),
                      NameOf(unit.worker), unit.stored.stats.seconds());
  if (scheduler_.UnitCommitted(ref)) {
    options_.log->info("event=frame_committed job={} frame={}", ref.job.value(), ref.key.frame);
    committed_frames_.push_back({ref.job, ref.key.frame});
  }
  changed_jobs_.insert(ref.job);
  housekeeping_.Signal();
}

void Coordinator::GrantLeases() {
  if (!leasing_) return;
  for (const scheduler::SetAsideWorker& aside : scheduler_.TakeSetAside()) {
    options_.log->warn("event=worker_set_aside worker={} seconds={:.0f} reason={}", NameOf(aside.worker),
                       absl::ToDoubleSeconds(aside.until - options_.now()), Quoted(aside.reason));
  }
  v1::CoordinatorMessage message;
  WorkerId to;
  JobId granting;
  const auto send = [&]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (message.grant().leases_size() > 0) workers_.at(to).sink->Send(message);
    message.Clear();
  };
  for (const scheduler::GrantedLease& lease : scheduler_.GrantLeases(options_.now())) {
    const JobId& job = lease.unit.job;
    if (lease.worker != to || job != granting || message.grant().leases_size() >= kMaxLeasesPerGrant) send();
    to = lease.worker;
    granting = job;
    if (lease.alone) {
      options_.log->warn("event=unit_in_quarantine unit={} worker={}", Quoted(Describe(lease.unit)),
                         NameOf(lease.worker));
    }
    if (workers_.at(to).known_jobs.insert(job).second)
      *message.mutable_grant()->mutable_spec() = scheduler_.SpecOf(job);
    *message.mutable_grant()->add_leases() = ProtoFromLease(lease);
    ledger::JobRecord& record = active_jobs_.at(job);
    if (record.started == absl::InfinitePast()) record.started = options_.now();
    changed_jobs_.insert(job);
    housekeeping_.Signal();
  }
  send();
}

void Coordinator::Acknowledge(WorkerId worker, const UnitRef& unit, Attempt attempt,
                              const std::string& refused) {
  const auto found = workers_.find(worker);
  if (found == workers_.end()) return;
  v1::CoordinatorMessage message;
  *message.mutable_ack()->mutable_unit() = ProtoFromUnit(unit);
  message.mutable_ack()->set_attempt(attempt.value());
  message.mutable_ack()->set_refused(refused);
  found->second.sink->Send(message);
}

void Coordinator::EndJob(const JobId& job, v1::JobState state, const std::string& cause) {
  const std::string error = rpc::BoundedLine(cause, rpc::kMaxErrorBytes);
  if (!active_jobs_.contains(job)) return;
  if (absl::Status status = store_->EndJob(job, state, error); !status.ok()) {
    // The job ends in memory; after a restart it is active again.
    options_.log->error("event=ledger_failed job={} error={}", job.value(),
                        Quoted(std::string(status.message())));
  }
  scheduler_.EndJob(job);
  active_jobs_.erase(job);
  finisher_->CancelJob(job);
  std::erase_if(losses_, [&job](const auto& entry) { return entry.first.first == job; });
  committer_->Discard(job, std::nullopt);
  v1::CoordinatorMessage message;
  message.mutable_job_ended()->set_job_id(job.value());
  for (auto& [id, worker] : workers_) {
    if (worker.known_jobs.erase(job) > 0) worker.sink->Send(message);
  }
  changed_jobs_.insert(job);
  housekeeping_.Signal();
  options_.log->info("event=job_ended job={} state={} error={}", job.value(), v1::JobState_Name(state),
                     Quoted(error));
  GrantLeases();
}

std::string Coordinator::NameOf(WorkerId worker) const {
  const auto found = workers_.find(worker);
  const std::string id = absl::StrCat("w-", worker.value());
  return found == workers_.end() ? id : absl::StrCat(id, "/", found->second.name);
}

}  // namespace lumifold::server
