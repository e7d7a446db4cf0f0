// What the farm tells its workers: grants, revocations, moves; and what follows from audits.
#include <spdlog/logger.h>

#include <algorithm>
#include <map>
#include <optional>
#include <string_view>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/logging/fields.h"
#include "server/coordinator/farm.h"
#include "server/coordinator/farm_keeping.h"
#include "server/picture/make_picture.h"

namespace lumifold::server {
namespace {

using job::JobId;
using job::WorkerId;

constexpr int kMaxLeasesPerGrant = 256;

v1::Lease ProtoFromLease(const scheduler::GrantedLease& lease) {
  v1::Lease proto;
  *proto.mutable_unit() = ProtoFromUnit(lease.unit);
  proto.set_attempt(lease.attempt.value());
  proto.set_keep(lease.keep);
  proto.mutable_rect()->set_x0(lease.rect.x0);
  proto.mutable_rect()->set_y0(lease.rect.y0);
  proto.mutable_rect()->set_x1(lease.rect.x1);
  proto.mutable_rect()->set_y1(lease.rect.y1);
  if (lease.samples.IsUniform()) {
    proto.set_first_sample(static_cast<int32_t>(lease.samples.blocks()[0].first));
    proto.set_last_sample(static_cast<int32_t>(lease.samples.blocks()[0].last));
    return proto;
  }
  for (const SampleRange& block : lease.samples.blocks()) {
    proto.add_block_samples(block.first);
    proto.add_block_samples(block.last);
  }
  return proto;
}

std::string_view LeasedEventOf(const FramePart& part) {
  if (part.IsBlock()) return "block_leased";
  return part.IsEstimate() ? "estimate_leased" : "frame_leased";
}

std::string_view EventOf(scheduler::Lateness lateness) {
  switch (lateness) {
    case scheduler::Lateness::kStalled:
      return "lease_stalled";
    case scheduler::Lateness::kOverdue:
      return "unit_overdue";
    case scheduler::Lateness::kDropped:
      return "lease_dropped";
    default:
      return "lease_expired";
  }
}

}  // namespace

void Farm::Complete() {
  for (const scheduler::FailedJob& job : scheduler.TakeFailedJobs()) {
    if (!is_leasing()) continue;
    if (job.frame.has_value()) {
      FailFrame({job.job, *job.frame}, job.error);
    } else {
      FailJob(job.job, job.error);
    }
  }
  if (is_leasing()) {
    FollowAudits();
    FollowKeeping(*resources_, this);
    for (const scheduler::CoolingWorker& cooling : scheduler.workers().TakeCooling()) {
      resources_->log().warn(
          "event=worker_set_aside worker={} seconds={:.0f} reason={}", workers.NameOf(cooling.worker),
          absl::ToDoubleSeconds(cooling.until - resources_->options.now()), logging::Quoted(cooling.reason));
    }
    SendRevoked();
    if (resources_->storage.ok()) SendGrants(scheduler.GrantLeases(resources_->options.now()));
  }
  if (watchers.TakeNews()) effects_->WakeHousekeeping();
  if (frames.TakeNews()) effects_->WakeFinisher();
}

void Farm::FollowAudits() {
  for (const scheduler::FaultyWorker& faulty : scheduler.workers().TakeFaulty()) {
    std::map<FrameKey, std::vector<job::UnitKey>> units;
    for (const job::UnitRef& unit : faulty.units) units[{unit.job, unit.key.frame}].push_back(unit.key);
    for (const auto& [frame, keys] : units) {
      const bool is_kept = scheduler.keeping().KeeperOf(frame.first, frame.second).has_value();
      if (!is_kept) effects_->DiscardUnits(frame, keys);
      StopKeeping(*resources_, frame, "worker_faulty", this);
    }
    if (faulty.reason.empty()) continue;
    resources_->log().error("event=worker_faulty worker={} units={} reason={}",
                            absl::StrCat("-/", faulty.name), faulty.units.size(),
                            logging::Quoted(faulty.reason));
    // Last: after a crash in between, the audits that a restart begins again find the rest of its units.
    effects_->RecordBlock(faulty.name, faulty.reason);
  }
  for (const auto& [job, frame] : scheduler.frames().TakeSettled()) {
    if (!scheduler.frames().IsCommitted(job, frame)) continue;
    resources_->log().info("event=frame_committed job={} frame={}", job.value(), frame);
    QueueDue({job, frame});
  }
}

void Farm::SendRevoked() {
  std::map<WorkerId, v1::CoordinatorMessage> messages;
  for (const scheduler::RevokedLease& lease : scheduler.units().TakeRevoked()) {
    if (jobs.FindActive(lease.unit.job) == nullptr) continue;  // JobEnded says so
    v1::Lease* const revoked = messages[lease.worker].mutable_void_leases()->add_leases();
    *revoked->mutable_unit() = ProtoFromUnit(lease.unit);
    revoked->set_attempt(lease.attempt.value());
  }
  for (const auto& [worker, message] : messages) {
    if (workers.Find(worker) == nullptr) continue;
    resources_->log().info("event=leases_void worker={} leases={}", workers.NameOf(worker),
                           message.void_leases().leases_size());
    workers.Send(worker, message);
  }
}

void Farm::SendGrants(const std::vector<scheduler::GrantedLease>& leases) {
  v1::CoordinatorMessage message;
  WorkerId to;
  JobId granting;
  const auto send = [&] {
    if (message.grant().leases_size() > 0) workers.Send(to, message);
    message.Clear();
  };
  const absl::Time now = resources_->options.now();
  for (const scheduler::GrantedLease& lease : leases) {
    const JobId& job = lease.unit.job;
    if (lease.worker != to || job != granting || message.grant().leases_size() >= kMaxLeasesPerGrant) send();
    to = lease.worker;
    granting = job;
    if (lease.alone) {
      resources_->log().warn("event=unit_in_quarantine unit={} worker={}",
                             logging::Quoted(Describe(lease.unit)), workers.NameOf(lease.worker));
    }
    workers.Find(to)->known_jobs.insert(job);
    *message.mutable_grant()->add_leases() = ProtoFromLease(lease);
    ActiveJob* const active = jobs.FindActive(job);
    message.mutable_grant()->set_trace_id(active->record.scheduling.trace_id());
    resources_->log().debug("event=lease_granted unit={} worker={} attempt={}",
                            logging::Quoted(Describe(lease.unit)), workers.NameOf(lease.worker),
                            lease.attempt.value());
    if (active->record.started == absl::InfinitePast())
      active->record.started = resources_->options.wall_now();
    if (!active->render_start.has_value())
      active->render_start = now - absl::Seconds(active->record.times.render_seconds());
    watchers.MarkChanged(job);
  }
  send();
}

std::optional<RunningFrame> Farm::BeginFrame(absl::Time now) {
  const auto state_of = [this](WorkerId worker) {
    const std::optional<scheduler::WorkerInfo> info = scheduler.workers().Describe(worker);
    return info.has_value() ? info->state : v1::WORKER_STATE_UNSPECIFIED;
  };
  const auto is_blocked = [&](WorkerId worker) { return state_of(worker) == v1::WORKER_STATE_BLOCKED; };
  const auto is_available = [&](WorkerId worker) {
    const v1::WorkerState state = state_of(worker);
    return state == v1::WORKER_STATE_IDLE || state == v1::WORKER_STATE_BUSY;
  };
  const auto may_have = [&](WorkerId worker, const JobId& job) {
    return is_available(worker) && !finish_leases.IsExcluded(worker, job, now);
  };
  TakeFramesBack(finish_leases.Expired(now, is_blocked), "expired", Return::kFailed);
  const auto find_worker = [&](const DueFrame& due, const Claims& claims) -> std::optional<WorkerId> {
    if (!scheduler.jobs().Has(due.job)) return std::nullopt;
    const auto may_finish = [&](WorkerId worker) {
      const bool may =
          due.keeper.has_value() ? *due.keeper == worker && is_available(worker) : may_have(worker, due.job);
      return may && std::none_of(claims.begin(), claims.end(), [&](const ClaimedResult& claim) {
               return claim.worker == workers.Find(worker)->name;
             });
    };
    return finish_leases.FindPlace(scheduler.jobs().NumericClassOf(due.job), due.memory_bytes, may_finish);
  };
  frames.OfferBlocks([&](const DueFrame& due) {
    return is_leasing() && scheduler.jobs().Has(due.job) &&
           finish_leases.HasOffer(scheduler.jobs().NumericClassOf(due.job), due.memory_bytes,
                                  [&](WorkerId worker) { return may_have(worker, due.job); });
  });
  while (true) {
    std::optional<RunningFrame> frame = frames.Begin(now);
    if (!frame.has_value() && is_leasing()) frame = frames.BeginAway(now, find_worker);
    if (!frame.has_value()) return std::nullopt;
    if (jobs.FindActive(frame->due.job) != nullptr && IsDue(frame->due)) {
      if (frame->worker.has_value()) SendFrame(*frame);
      watchers.MarkChanged(frame->due.job);
      return frame;
    }
    if (frame->worker.has_value()) frames.MarkStale(frame->due.key());
    frames.End(frame->part(), now);
  }
}

void Farm::SendFrame(const RunningFrame& frame) {
  const DueFrame& due = frame.due;
  const WorkerId worker = *frame.worker;
  const job::Attempt attempt = scheduler.NextAttempt();
  const v1::JobSpec& spec = jobs.FindActive(due.job)->record.spec;
  const Rect rect =
      frame.part().IsBlock() ? FrameBlocks(spec).Input(frame.block) : Rect{0, 0, spec.width(), spec.height()};
  finish_leases.Grant(attempt,
                      {.part = frame.part(),
                       .worker = worker,
                       .memory_bytes = due.memory_bytes,
                       .pixels = int64_t{rect.width()} * rect.height()},
                      frame.since);
  workers.Find(worker)->known_jobs.insert(due.job);
  v1::CoordinatorMessage message;
  v1::Lease* const lease = message.mutable_grant()->add_leases();
  *lease->mutable_unit() = job::ProtoFromUnit(UnitOf(frame.part()));
  lease->set_attempt(attempt.value());
  lease->set_keep(due.keeper.has_value());
  message.mutable_grant()->set_trace_id(jobs.FindActive(due.job)->record.scheduling.trace_id());
  workers.Send(worker, message);
  resources_->log().info("event={} unit={} worker={} attempt={} kept={}", LeasedEventOf(frame.part()),
                         logging::Quoted(Describe(UnitOf(frame.part()))), workers.NameOf(worker),
                         attempt.value(), due.keeper.has_value());
}

void Farm::TakeFramesBack(const std::vector<job::Attempt>& leases, std::string_view reason, Return how) {
  for (const job::Attempt attempt : leases) {
    const FinishLease lease = finish_leases.End(attempt);
    frames.ComeBack(lease.part, resources_->options.now());
    if (how == Return::kFailed)
      finish_leases.Exclude(lease.party, lease.part.frame.first, resources_->options.now());
    v1::CoordinatorMessage message;
    v1::Lease* const ended = message.mutable_void_leases()->add_leases();
    *ended->mutable_unit() = job::ProtoFromUnit(UnitOf(lease.part));
    ended->set_attempt(attempt.value());
    workers.Send(lease.worker, message);
    resources_->log().warn("event=frame_came_back unit={} worker={} reason={}",
                           logging::Quoted(Describe(UnitOf(lease.part))), workers.NameOf(lease.worker),
                           logging::Quoted(std::string(reason)));
    if (how == Return::kFailed) scheduler.keeping().Exclude(lease.worker);
    StopKeeping(*resources_, lease.part.frame, reason, this);
  }
}

void Farm::MoveWorker(WorkerId worker, const std::string& to, bool at_once) {
  resources_->log().info("event=worker_moved worker={} address={} at_once={}", workers.NameOf(worker),
                         logging::Quoted(to), at_once);
  scheduler.workers().Drain(worker);
  v1::CoordinatorMessage message;
  message.mutable_move()->set_address(to);
  message.mutable_move()->set_at_once(at_once);
  workers.Send(worker, message);
}

void Farm::ReportLate(const std::vector<scheduler::LateLease>& late) {
  for (const scheduler::LateLease& lease : late) {
    resources_->log().warn("event={} unit={} worker={}", EventOf(lease.lateness),
                           logging::Quoted(Describe(lease.unit)), workers.NameOf(lease.worker));
  }
}

}  // namespace lumifold::server
