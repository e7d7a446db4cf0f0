#include "server/coordinator/finish_delivery.h"

#include <spdlog/logger.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "filter/image/file_calls.h"
#include "filter/image/file_io.h"
#include "proto/logging/fields.h"
#include "proto/rpc/byte_stream.h"
#include "proto/rpc/sha256.h"
#include "server/coordinator/farm_keeping.h"
#include "server/film/result_digest.h"
#include "server/film/unit_film.h"
#include "server/finish/estimate_round.h"
#include "server/picture/filtered_round.h"
#include "server/picture/make_picture.h"

namespace lumifold::server {
namespace {

/// Of a result: all channels of all levels, and room for names and lists.
constexpr uint64_t kMaxBytesPerPixel = 2000;
constexpr uint64_t kMaxOtherBytes = uint64_t{64} << 20;
constexpr double kMaxSeconds = 1e6;

/// A lease to finish a frame, as a worker names it.
struct NamedLease {
  job::WorkerId worker{};
  FramePart part;
  job::Attempt attempt{};
};

/// Errors: kNotFound for a job that is not active, kPermissionDenied where the caller has no such lease.
absl::StatusOr<NamedLease> FindLease(Farm* farm, const std::string& worker_id, const std::string& caller,
                                     const v1::UnitId& unit, int64_t attempt) {
  if (farm->jobs.FindActive(job::JobId(unit.job_id())) == nullptr)
    return absl::NotFoundError(absl::StrCat("no active job ", logging::Quoted(unit.job_id())));
  const std::optional<job::WorkerId> worker = job::ParseWorkerId(worker_id);
  const ConnectedWorker* const connected = worker.has_value() ? farm->workers.Find(*worker) : nullptr;
  NamedLease lease = {worker.value_or(job::WorkerId()), PartOf(job::UnitFromProto(unit)),
                      job::Attempt(attempt)};
  const bool is_of_caller = connected != nullptr && connected->caller == caller;
  if (!is_of_caller || !IsOfFinishing(unit.kind()) ||
      farm->finish_leases.Find(lease.worker, lease.part, lease.attempt) == nullptr) {
    return absl::PermissionDeniedError(absl::StrCat("worker ", logging::Quoted(worker_id),
                                                    " has no lease to finish frame ", unit.frame(),
                                                    " of job ", logging::Quoted(unit.job_id())));
  }
  return lease;
}

Claims ClaimsOf(const FrameQueue& frames, const FramePart& part) {
  for (const RunningFrame& frame : frames.running()) {
    if (frame.part() == part) return frame.due.claims;
  }
  return {};
}

/// What is kept of the times that a worker tells.
v1::StageTimes StoredTimes(const v1::StageTimes& told) {
  const auto bounded = [](double seconds) { return seconds > 0 ? std::min(seconds, kMaxSeconds) : 0.0; };
  v1::StageTimes times;
  times.set_assemble_seconds(bounded(told.assemble_seconds()));
  times.set_filter_seconds(bounded(told.filter_seconds()));
  times.set_write_seconds(bounded(told.write_seconds()));
  return times;
}

/// What is recorded of a worker's announcement.
/// Errors: kInvalidArgument without an estimated error that is due.
absl::StatusOr<v1::FrameReport> ReportOf(const v1::ResultAnnouncement& announcement, const FramePart& part,
                                         const v1::JobSpec& spec) {
  v1::FrameReport report;
  *report.mutable_times() = StoredTimes(announcement.times());
  report.set_core_seconds(FrameFinishing::SumOf(report.times()));
  if (!part.IsResult() || !spec.has_adaptive()) return report;
  const double error = announcement.has_estimated_error() ? announcement.estimated_error() : -1;
  if (!std::isfinite(error) || error < 0)
    return absl::InvalidArgumentError("result: its estimated error is missing or not valid");
  report.set_estimated_error(error);
  return report;
}

/// Bytes of the file that is made of a part of a frame; nullopt where they are not known.
std::optional<uint64_t> BytesOf(const FramePart& part, const v1::JobSpec& spec) {
  if (part.IsBlock()) return FrameBlocks(spec).PictureBytes(part.block);
  return part.IsEstimate() ? std::optional(ErrorBytesOf(spec)) : std::nullopt;
}

/// Receives a result, or the picture of a block or the errors of a round, of which this coordinator makes
/// one, beside the place where it belongs, and puts it there.
class ReceivedResult final : public ResultUpload {
 public:
  ReceivedResult(Resources* resources, FarmState* state, FrameFinishing* finishing, NamedLease lease,
                 DueFrame due, v1::FrameReport report, std::optional<uint64_t> bytes, uint64_t max_bytes,
                 std::string audited)
      : resources_(resources),
        state_(state),
        finishing_(finishing),
        lease_(std::move(lease)),
        due_(std::move(due)),
        report_(std::move(report)),
        bytes_(bytes),
        max_bytes_(max_bytes),
        audited_(std::move(audited)),
        path_(PathOf(resources->folder, lease_.part)),
        partial_(absl::StrCat(path_, ".", lease_.attempt.value(), kPartialSuffix)) {}
  ~ReceivedResult() override { resources_->folder.files()->Remove(partial_); }

  absl::Status Open() {
    if (absl::Status status =
            MakeFolder(resources_->folder.ResultsPath(due_.job), resources_->folder.files());
        !status.ok())
      return status;
    absl::StatusOr<rpc::ByteReceiver> file = rpc::ByteReceiver::Open(partial_, 0, resources_->folder.files());
    absl::Status status = file.status();
    if (file.ok()) file_ = *std::move(file);
    return status;
  }

  absl::Status Add(const v1::ByteChunk& chunk) override {
    if (chunk.total_size() > max_bytes_)
      return absl::InvalidArgumentError(absl::StrCat("result: ", chunk.total_size(), " bytes are too many"));
    if (sha256_.empty()) sha256_ = chunk.sha256();
    resources_->traffic.results_received += static_cast<int64_t>(chunk.data().size());
    sum_.Update(chunk.data());
    return resources_->NoteError(file_->Add(chunk));
  }

  absl::Status Finish() override {
    if (absl::Status status = Check(); !status.ok()) return resources_->NoteError(status);
    {
      FarmState::Change farm(state_);
      FinishLease* const lease = farm->finish_leases.Find(lease_.worker, lease_.part, lease_.attempt);
      const bool is_stale = !lease_.part.IsResult() && farm->frames.IsStale(lease_.part.frame);
      if (lease == nullptr || lease->is_delivered || is_stale)
        return absl::AbortedError("result: the lease has become void");
      lease->is_delivered = true;
      due_.kept = EndKeeping(lease_.part.frame, &*farm);
    }
    if (!audited_.empty() && !IsConfirmed()) return Compare();
    const absl::Status placed = Place();
    const absl::StatusOr<v1::FrameReport> report =
        placed.ok() ? absl::StatusOr<v1::FrameReport>(report_) : placed;
    const bool is_result = lease_.part.IsResult();
    if (is_result && !absl::IsAborted(placed)) finishing_->OnFinished(due_, report);
    FarmState::Change farm(state_);
    farm->finish_leases.End(lease_.attempt);
    if (!is_result && !placed.ok()) {
      farm->frames.ComeBack(lease_.part, resources_->options.now());
    } else {
      farm->frames.End(lease_.part, resources_->options.now(), report_.core_seconds());
    }
    return resources_->NoteError(placed);
  }

 private:
  absl::Status Check() {
    if (bytes_.has_value() && file_->total_size() != *bytes_)
      return absl::InvalidArgumentError(absl::StrCat("result: the file has to have ", *bytes_, " bytes"));
    if (absl::Status status = file_->Sync(); !status.ok()) return status;
    if (sum_.FinishHex() != sha256_) return absl::DataLossError("result: the SHA-256 does not match");
    return absl::OkStatus();
  }

  ClaimedResult Claim() const { return {audited_, sha256_, EstimatedErrorOf(report_)}; }
  /// Whether another worker has made the same.
  bool IsConfirmed() const {
    return std::any_of(due_.claims.begin(), due_.claims.end(),
                       [this](const ClaimedResult& claim) { return claim.Confirms(Claim()); });
  }

  /// Somebody else is to make the frame again.
  absl::Status Compare() {
    FarmState::Change farm(state_);
    farm->finish_leases.End(lease_.attempt);
    farm->frames.Audit(lease_.part, Claim(), resources_->options.now());
    resources_->log().info("event=frame_compared unit={} worker={}",
                           logging::Quoted(Describe(UnitOf(lease_.part))), audited_);
    return absl::OkStatus();
  }

  absl::Status Place() {
    FileSystem* const files = resources_->folder.files();
    if (absl::Status status = CheckOwner(*resources_->store, resources_->Owned(due_.job)); !status.ok())
      return status;
    if (const int error = files->Rename(partial_, path_); error != 0) return StorageError(path_, error);
    if (!lease_.part.IsResult()) return absl::OkStatus();
    if (const int error = files->SyncFolder(FolderOf(path_)); error != 0) return StorageError(path_, error);
    return film::WriteResultDigest(path_, sha256_, files);
  }

  Resources* const resources_;
  FarmState* const state_;
  FrameFinishing* const finishing_;
  const NamedLease lease_;
  DueFrame due_;
  const v1::FrameReport report_;
  const std::optional<uint64_t> bytes_;  // of the file, where they are known
  const uint64_t max_bytes_;
  const std::string audited_;  // the worker's name, if the frame is; else empty
  const std::string path_;
  const std::string partial_;
  std::optional<rpc::ByteReceiver> file_;
  rpc::Sha256 sum_;     // of what has arrived
  std::string sha256_;  // as the worker says
};

}  // namespace

absl::StatusOr<UnitSender> FinishDelivery::OpenUnits(const v1::FetchUnitsRequest& request,
                                                     const std::string& caller) const {
  ledger::JobRecord job;
  FramePart part;
  {
    FarmState::Change farm(state_);
    const absl::StatusOr<NamedLease> lease =
        FindLease(&*farm, request.worker_id(), caller, request.unit(), request.attempt());
    if (!lease.ok()) return lease.status();
    part = lease->part;
    job = farm->jobs.FindActive(part.frame.first)->record;
  }
  absl::StatusOr<CommittedUnits> units =
      CommittedUnits::Open(resources_->folder, *resources_->store, job, request.unit().frame());
  if (!units.ok()) return units.status();
  if (job.spec.has_adaptive()) {
    const absl::StatusOr<v1::RoundEstimates> rounds =
        ReadEstimates(resources_->folder.RoundsPath(job.id, request.unit().frame()));
    if (!rounds.ok()) return rounds.status();
    if (part.IsEstimate()) units->KeepPasses(part.round);
    return UnitSender(*std::move(units), 0, rounds->SerializeAsString());
  }
  if (!part.IsBlock()) return UnitSender(*std::move(units));
  const absl::StatusOr<uint64_t> levels = LevelsOf(part.frame, job.spec, *units);
  if (!levels.ok()) return levels.status();
  units->KeepTiles(job::FrameUnits(job.spec).tiles().TilesIn(FrameBlocks(job.spec).Input(part.block)));
  return UnitSender(*std::move(units), *levels);
}

absl::StatusOr<uint64_t> FinishDelivery::LevelsOf(const FrameKey& frame, const v1::JobSpec& spec,
                                                  const CommittedUnits& units) const {
  constexpr size_t kMaxFrames = 64;
  std::shared_ptr<FrameLevels> found;
  {
    absl::MutexLock lock(&mutex_);
    if (levels_.size() >= kMaxFrames && !levels_.contains(frame)) levels_.clear();
    std::shared_ptr<FrameLevels>& entry = levels_[frame];
    if (entry == nullptr) entry = std::make_shared<FrameLevels>();
    found = entry;
  }
  const size_t fingerprint = units.Fingerprint();
  absl::MutexLock lock(&found->mutex);
  if (found->levels.has_value() && found->units == fingerprint) return *found->levels;
  const absl::StatusOr<film::UnitFilm> film = film::UnitFilm::Open(spec, frame.second, &units, nullptr);
  if (!film.ok()) return film.status();
  found->units = fingerprint;
  found->levels = film->levels().to_ullong();
  return *found->levels;
}

absl::StatusOr<std::unique_ptr<ResultUpload>> FinishDelivery::Receive(
    const v1::ResultAnnouncement& announcement, const std::string& caller) const {
  std::unique_ptr<ReceivedResult> result;
  {
    FarmState::Change farm(state_);
    absl::StatusOr<NamedLease> lease =
        FindLease(&*farm, announcement.worker_id(), caller, announcement.unit(), announcement.attempt());
    if (!lease.ok()) return lease.status();
    const ledger::JobRecord& job = farm->jobs.FindActive(lease->part.frame.first)->record;
    const v1::JobSpec& spec = job.spec;
    const auto pixels = static_cast<uint64_t>(spec.width()) * static_cast<uint64_t>(spec.height());
    const std::optional<uint64_t> bytes = BytesOf(lease->part, spec);
    absl::StatusOr<v1::FrameReport> report = ReportOf(announcement, lease->part, spec);
    if (!report.ok()) return report.status();
    DueFrame due = {.job = lease->part.frame.first,
                    .number = lease->part.frame.second,
                    .claims = ClaimsOf(farm->frames, lease->part)};
    const bool is_audited =
        !lease->part.IsEstimate() && scheduler::IsAudited(UnitOf(lease->part), job.scheduling.audit_share());
    std::string audited = is_audited ? farm->workers.Find(lease->worker)->name : "";
    result = std::make_unique<ReceivedResult>(
        resources_, state_, finishing_, *std::move(lease), std::move(due), *std::move(report), bytes,
        pixels * kMaxBytesPerPixel + kMaxOtherBytes, std::move(audited));
  }
  if (absl::Status status = resources_->NoteError(result->Open()); !status.ok()) return status;
  return result;
}

void FinishDelivery::TakeBack(job::WorkerId worker, const job::UnitRef& unit, job::Attempt attempt,
                              const std::string& reason, Farm::Return how) const {
  FarmState::Change farm(state_);
  const FinishLease* const lease = farm->finish_leases.Find(worker, PartOf(unit), attempt);
  if (lease != nullptr && !lease->is_delivered) farm->TakeFramesBack({attempt}, reason, how);
}

}  // namespace lumifold::server
