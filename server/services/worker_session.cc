#include "server/services/worker_session.h"

#include <optional>
#include <string>
#include <utility>

#include "proto/rpc/bounded_text.h"
#include "proto/rpc/limits.h"
#include "server/film/stored_stats.h"

namespace lumifold::server {
namespace {

/// The plan that is stored: its texts are bounded, and fields that are not known are dropped.
v1::Plan StoredPlan(const v1::Plan& delivered) {
  v1::Plan plan;
  for (const v1::PlanDecision& decision : delivered.decisions()) {
    v1::PlanDecision* stored = plan.add_decisions();
    stored->set_name(decision.name());
    stored->set_value(decision.value());
    stored->set_source(decision.source());
    stored->set_reason(rpc::BoundedLine(decision.reason(), rpc::kMaxReasonBytes));
    stored->set_saving(rpc::BoundedLine(decision.saving(), rpc::kMaxReasonBytes));
  }
  plan.set_probe_rays(delivered.probe_rays());
  plan.set_probe_seconds(delivered.probe_seconds());
  plan.set_seconds_per_sample(delivered.seconds_per_sample());
  plan.set_noise(delivered.noise());
  plan.set_memory_bytes(delivered.memory_bytes());
  *plan.mutable_tile_order() = delivered.tile_order();
  return plan;
}

}  // namespace

absl::StatusOr<std::unique_ptr<WorkerSession>> WorkerSession::Open(WorkerApi* workers, const v1::Hello& hello,
                                                                   const access::Identity& caller,
                                                                   WorkerSink* sink) {
  const absl::StatusOr<job::WorkerId> worker = workers->AddWorker(hello, caller, sink);
  if (!worker.ok()) return worker.status();
  return std::unique_ptr<WorkerSession>(new WorkerSession(workers, *worker));
}

WorkerSession::~WorkerSession() { workers_->RemoveWorker(worker_); }

absl::Status WorkerSession::Handle(v1::WorkerMessage* message) {
  switch (message->message_case()) {
    case v1::WorkerMessage::kHeartbeat:
      OnHeartbeat(message->heartbeat());
      return absl::OkStatus();
    case v1::WorkerMessage::kChunk:
      OnChunk(message->mutable_chunk());
      return absl::OkStatus();
    case v1::WorkerMessage::kPlan:
      OnPlan(message->mutable_plan());
      return absl::OkStatus();
    case v1::WorkerMessage::kKept:
      OnKept(message->kept());
      return absl::OkStatus();
    case v1::WorkerMessage::kFailure:
      OnFailure(message->failure());
      return absl::OkStatus();
    case v1::WorkerMessage::kHandBack:
      workers_->HandBack(worker_, message->hand_back());
      return absl::OkStatus();
    case v1::WorkerMessage::kLeaving:
      workers_->OnLeaving(worker_, rpc::BoundedLine(message->leaving().reason(), rpc::kMaxReasonBytes));
      return absl::OkStatus();
    case v1::WorkerMessage::kRest:
      workers_->OnRest(worker_, rpc::BoundedLine(message->rest().reason(), rpc::kMaxReasonBytes));
      return absl::OkStatus();
    default:
      return absl::InvalidArgumentError("worker stream: a second Hello, or an unknown message");
  }
}

void WorkerSession::OnHeartbeat(const v1::Heartbeat& heartbeat) {
  workers_->KeepLog(worker_, heartbeat.log());
  workers_->OnHeartbeat(worker_, heartbeat);
  std::erase_if(arriving_, [this](const auto& entry) {
    const auto& [unit, attempt] = entry.first;
    return !workers_->FindLease(worker_, unit, attempt).has_value();
  });
}

void WorkerSession::OnFailure(const v1::UnitFailure& failure) {
  const job::UnitRef unit = job::UnitFromProto(failure.unit());
  const job::Attempt attempt(failure.attempt());
  const std::string error = rpc::BoundedLine(failure.error(), rpc::kMaxErrorBytes);
  workers_->KeepLog(worker_, failure.log());
  if (failure.has_missing_asset()) {
    workers_->OnAssetMissing(worker_, unit, attempt, failure.missing_asset().sha256(), error);
  } else {
    workers_->FailUnit(
        worker_, unit, attempt,
        {.permanent = failure.permanent(), .out_of_memory = failure.out_of_memory(), .error = error});
  }
}

void WorkerSession::OnChunk(v1::UnitChunk* chunk) {
  const LeaseName lease(job::UnitFromProto(chunk->unit()), job::Attempt(chunk->attempt()));
  const std::optional<LeasedUnit> leased = workers_->FindLease(worker_, lease.first, lease.second);
  if (leased.has_value()) {
    const absl::Status status = Take(chunk, lease, *leased);
    if (status.ok()) return;
    arriving_.erase(lease);
    return workers_->RefuseUnit(worker_, lease.first, lease.second, std::string(status.message()));
  }
  arriving_.erase(lease);
  // The worker waits for an acknowledgement of the last piece, even if the unit is not wanted.
  if (chunk->pixels().last()) workers_->Dismiss(worker_, lease.first, lease.second);
}

void WorkerSession::OnPlan(v1::DeliveredPlan* delivered) {
  const job::UnitRef unit = job::UnitFromProto(delivered->unit());
  const job::Attempt attempt(delivered->attempt());
  const absl::Status status =
      unit.key.kind == v1::UNIT_KIND_PLAN
          ? workers_->DeliverPlan(worker_, unit, attempt, StoredPlan(delivered->plan()))
          : absl::InvalidArgumentError("unit: a plan was delivered for it");
  if (!status.ok()) workers_->RefuseUnit(worker_, unit, attempt, std::string(status.message()));
}

void WorkerSession::OnKept(const v1::KeptUnit& kept) {
  workers_->Keep(worker_, {.unit = job::UnitFromProto(kept.unit()),
                           .attempt = job::Attempt(kept.attempt()),
                           .stats = film::StoredStats(kept.stats()),
                           .record_bytes = kept.record_bytes()});
}

absl::Status WorkerSession::Take(v1::UnitChunk* chunk, const LeaseName& lease, const LeasedUnit& leased) {
  if (lease.first.key.kind == v1::UNIT_KIND_PLAN)
    return absl::InvalidArgumentError("unit: a plan unit has no pixels");
  const auto entry =
      arriving_.try_emplace(lease, lease.first.key.kind, leased.rect, leased.samples, leased.model).first;
  const v1::UnitStats stats = film::StoredStats(chunk->stats());
  if (absl::Status status = entry->second.Add(std::move(*chunk)); !status.ok()) return status;
  if (!entry->second.IsComplete()) return absl::OkStatus();
  film::EncodedUnit unit = film::EncodeUnit(lease.first, lease.second, stats, entry->second.Take());
  arriving_.erase(entry);
  workers_->Deliver(worker_, std::move(unit));
  return absl::OkStatus();
}

}  // namespace lumifold::server
