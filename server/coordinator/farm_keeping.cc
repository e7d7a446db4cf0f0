#include "server/coordinator/farm_keeping.h"

#include <spdlog/logger.h>

#include <algorithm>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include "proto/logging/fields.h"
#include "server/picture/make_picture.h"
#include "server/picture/picture_code.h"

namespace lumifold::server {
namespace {

using job::JobId;
using job::WorkerId;

/// Frames that travel, for each that this coordinator can finish at a time: one more is being rendered, so
/// that its cores are not idle while workers finish all frames.
constexpr int kInFlight = 2;

/// Whether the result of each frame is made by one worker from units alone, and believed.
bool CanBeKept(const Resources& resources, const ledger::JobRecord& job, const std::string& numeric_class) {
  return !job.spec.has_adaptive() && job.scheduling.audit_share() == 0 &&
         SharesPictureCode(numeric_class, resources.options.finishing.other_bits) &&
         FrameBlocks(job.spec).count() == 1;
}

bool IsBeingFinished(const FrameQueue& frames, const FrameKey& frame) {
  return std::any_of(frames.running().begin(), frames.running().end(),
                     [&](const RunningFrame& running) { return running.due.key() == frame; });
}

}  // namespace

void LetKeep(const Resources& resources, const JobId& job, Farm* farm) {
  const ActiveJob* const active = farm->jobs.FindActive(job);
  if (active == nullptr || !CanBeKept(resources, active->record, farm->scheduler.jobs().NumericClassOf(job)))
    return;
  const uint64_t record_bytes =
      DemandOf(active->record.spec, farm->scheduler.jobs().UnitsOf(job), active->unit_bytes).log_bytes;
  const auto frames = static_cast<uint64_t>(farm->scheduler.jobs().Progress(job).frames_total);
  // Otherwise its film is kept for samples that are added.
  const bool is_too_large = frames * record_bytes > resources.options.retention.film_bytes;
  const uint64_t finish_bytes = PictureMemoryOf(active->record.spec);
  farm->scheduler.keeping().SetDemand(
      job, is_too_large
               ? scheduler::KeepDemand{record_bytes, finish_bytes,
                                       kInFlight * resources.options.finishing.PlacesFor(finish_bytes)}
               : scheduler::KeepDemand{});
}

void CountKept(const Resources& resources, WorkerId worker, const KeptUnit& kept, Farm* farm) {
  const JobId& job = kept.unit.job;
  ActiveJob* const active = farm->jobs.FindActive(job);
  if (active == nullptr) return;
  const scheduler::Scheduler& scheduler = farm->scheduler;
  film::EncodedUnit stored;  // without what is not here
  stored.unit = kept.unit;
  stored.attempt = kept.attempt;
  stored.stats = kept.stats;
  AcceptedUnit unit = {.stored = std::move(stored),
                       .worker = worker,
                       .worker_name = farm->workers.Find(worker)->name,
                       .samples = scheduler.jobs().UnitsOf(job).CameraSamplesOf(kept.unit.key),
                       .numeric_class = scheduler.jobs().NumericClassOf(job),
                       .started = active->record.started,
                       .accepted = resources.options.wall_now()};
  v1::UnitStats& stats = unit.stored.stats;
  stats.set_bad_samples(std::clamp<int64_t>(stats.bad_samples(), 0, unit.samples));
  ledger::JobCommit& commit = active->kept[kept.unit.key.frame];
  commit.job = resources.Owned(job);
  commit.numeric_class = unit.numeric_class;
  commit.started = unit.started;
  commit.warnings.insert(commit.warnings.end(), stats.warnings().begin(), stats.warnings().end());
  commit.units.push_back({.unit = kept.unit,
                          .attempt = kept.attempt,
                          .worker = unit.worker_name,
                          .file = "",
                          .samples = unit.samples,
                          .bad_samples = stats.bad_samples(),
                          .cost = ledger::UnitCost{unit.accepted, stats.seconds()}});
  farm->CountCommitted(unit);
}

void StopKeeping(const Resources& resources, const FrameKey& frame, std::string_view reason, Farm* farm) {
  const auto& [job, number] = frame;
  const std::optional<WorkerId> keeper = farm->scheduler.keeping().KeeperOf(job, number);
  ActiveJob* const active = farm->jobs.FindActive(job);
  if (!keeper.has_value() || active == nullptr) return;
  farm->scheduler.keeping().Stop(job, number);
  const auto kept = active->kept.extract(number);
  const size_t units = kept.empty() ? 0 : kept.mapped().units.size();
  if (units > 0) farm->RevokeUnits(job, kept.mapped().units);
  farm->frames.MarkStale(frame);
  v1::CoordinatorMessage message;
  v1::Lease* const dropped = message.mutable_void_leases()->add_leases();
  *dropped->mutable_unit() = job::ProtoFromUnit(UnitOf({frame}));
  dropped->set_keep(true);
  farm->workers.Send(*keeper, message);
  resources.log().warn("event=frame_kept_no_more job={} frame={} units={} worker={} reason={}", job.value(),
                       number, units, farm->workers.NameOf(*keeper), logging::Quoted(std::string(reason)));
}

void FollowKeeping(const Resources& resources, Farm* farm) {
  for (const auto& [job, number] : farm->scheduler.keeping().TakeBroken()) {
    // Its result may still come; if it does not, the end of that lease tells.
    if (IsBeingFinished(farm->frames, {job, number})) continue;
    StopKeeping(resources, {job, number}, "keeper_unavailable", farm);
  }
}

std::shared_ptr<const ledger::JobCommit> EndKeeping(const FrameKey& frame, Farm* farm) {
  const auto& [job, number] = frame;
  ActiveJob* const active = farm->jobs.FindActive(job);
  if (active == nullptr || !farm->scheduler.keeping().KeeperOf(job, number).has_value()) return nullptr;
  farm->scheduler.keeping().End(job, number);
  auto kept = active->kept.extract(number);
  return kept.empty() ? nullptr : std::make_shared<const ledger::JobCommit>(std::move(kept.mapped()));
}

}  // namespace lumifold::server
