#include "server/cluster/membership.h"

#include <spdlog/logger.h>

#include <algorithm>
#include <optional>
#include <string>
#include <utility>

#include "absl/strings/escaping.h"
#include "proto/logging/fields.h"
#include "proto/rpc/monotonic.h"

namespace lumifold::cluster {
namespace {

constexpr int kRenewalsPerLease = 6;
/// Jobs without an owner appear when a member leaves; others, of coordinators that ended before they were
/// members, are looked for this seldom.
constexpr absl::Duration kAdoptionInterval = absl::Seconds(10);
/// Between two moves of workers, in leases: by then those that moved are in the metrics of the roster.
constexpr double kLeasesPerMove = 0.7;
/// Between two attempts to send away workers that have come back, as they reached no other coordinator.
constexpr double kLeasesPerSendingAway = 10;

std::vector<ledger::Epoch> EpochsOf(const std::vector<ledger::Member>& members) {
  std::vector<ledger::Epoch> epochs;
  epochs.reserve(members.size());
  for (const ledger::Member& member : members) epochs.push_back(member.owner.epoch);
  return epochs;
}

/// The name of an owner begins with its machine.
std::string MachineOf(const ledger::Owner& owner) { return owner.name.substr(0, owner.name.find(':')); }

}  // namespace

Membership::Membership(MembershipOptions options, ledger::Roster* roster, MemberHost* host)
    : options_(std::move(options)),
      roster_(roster),
      host_(host),
      watch_(options_.lease),
      next_move_(rpc::MonotonicNow()),
      renewed_(next_move_) {}

absl::Status Membership::Start() {
  if (absl::Status status = roster_->Join({.owner = options_.owner, .address = options_.address});
      !status.ok())
    return status;
  options_.log->info("event=farm_joined coordinator={} epoch={} address={}",
                     logging::Quoted(options_.owner.name), options_.owner.epoch.value(), options_.address);
  if (absl::Status status = ExpelPredecessors(); !status.ok()) return status;
  if (absl::Status status = Tick(); !status.ok()) return status;
  thread_ = std::thread([this] { Run(); });
  database_watch_ = std::thread([this] { WatchDatabase(); });
  return absl::OkStatus();
}

absl::Status Membership::ExpelPredecessors() {
  absl::StatusOr<std::vector<ledger::Member>> members =
      roster_->Renew({.owner = options_.owner, .address = options_.address});
  if (!members.ok()) return members.status();
  for (const ledger::Member& member : *members) {
    const bool is_predecessor = member.owner.epoch < options_.owner.epoch &&
                                member.address == options_.address &&
                                MachineOf(member.owner) == MachineOf(options_.owner);
    if (!is_predecessor) continue;
    const absl::StatusOr<bool> expelled = roster_->Expel(member.owner.epoch, member.renewals);
    if (!expelled.ok()) return expelled.status();
  }
  return absl::OkStatus();
}

void Membership::Stop() {
  stop_.Notify();
  if (thread_.joinable()) thread_.join();
  if (database_watch_.joinable()) database_watch_.join();
}

void Membership::Leave() {
  const absl::Status status = roster_->Leave(options_.owner.epoch);
  if (status.ok()) {
    options_.log->info("event=farm_left");
  } else {  // the others find out
    options_.log->warn("event=farm_not_left error={}", logging::Quoted(status.message()));
  }
}

std::vector<ledger::Member> Membership::members() const {
  absl::MutexLock lock(&mutex_);
  return members_;
}

void Membership::Run() {
  while (!stop_.WaitFor(options_.lease / kRenewalsPerLease)) {
    const absl::Status status = Tick();
    if (absl::IsAborted(status)) {
      options_.log->error("event=expelled error={}", logging::Quoted(status.message()));
      return host_->OnExpelled();
    }
    if (status.ok()) continue;
    options_.log->warn("event=farm_not_renewed error={}", logging::Quoted(status.message()));
  }
}

void Membership::WatchDatabase() {
  absl::Time next = absl::InfinitePast();
  while (!stop_.WaitFor(options_.lease / kRenewalsPerLease)) {
    const absl::Time now = rpc::MonotonicNow();
    std::string address;
    {
      absl::MutexLock lock(&mutex_);
      if (now - renewed_ < options_.lease || now < next) continue;
      for (const ledger::Member& member : members_) {
        if (member.owner.epoch != options_.owner.epoch) address = member.address;
      }
    }
    next = now + options_.lease * kLeasesPerSendingAway;
    options_.log->warn("event=database_silent seconds={:.1f} workers_sent_to={}",
                       absl::ToDoubleSeconds(options_.lease),
                       logging::Quoted(address.empty() ? "any" : address));
    host_->SendWorkersAway(address);
  }
}

absl::Status Membership::Tick() {
  const absl::Time now = rpc::MonotonicNow();
  ledger::Member self{.owner = options_.owner, .address = options_.address};
  host_->SetMetrics(&self);
  absl::StatusOr<std::vector<ledger::Member>> members = roster_->Renew(self);
  if (!members.ok()) return members.status();
  {
    absl::MutexLock lock(&mutex_);
    renewed_ = now;
  }
  bool has_gone = false;
  for (const ledger::Member& member : watch_.Expired(*members, rpc::MonotonicNow())) {
    if (member.owner.epoch == options_.owner.epoch) continue;
    const absl::StatusOr<bool> expelled = roster_->Expel(member.owner.epoch, member.renewals);
    if (!expelled.ok()) return expelled.status();
    if (!*expelled) continue;
    options_.log->warn("event=coordinator_expelled coordinator={} epoch={}",
                       logging::Quoted(member.owner.name), member.owner.epoch.value());
    std::erase(*members, member);
    has_gone = true;
  }
  std::vector<ledger::Epoch> epochs = EpochsOf(*members);
  has_gone = has_gone || !std::includes(epochs.begin(), epochs.end(), known_.begin(), known_.end());
  known_ = std::move(epochs);
  {
    absl::MutexLock lock(&mutex_);
    members_ = *std::move(members);
  }
  if (has_gone || now >= next_adoption_) {
    if (absl::Status status = AdoptOrphans(); !status.ok()) return status;
    next_adoption_ = now + kAdoptionInterval;
  }
  host_->LookAtOthers();
  Balance(now);
  return absl::OkStatus();
}

absl::Status Membership::AdoptOrphans() {
  const absl::StatusOr<std::vector<ledger::AdoptedJob>> orphans = roster_->AdoptOrphans(options_.owner);
  if (!orphans.ok()) return orphans.status();
  if (!orphans->empty()) host_->Adopt(*orphans);
  return absl::OkStatus();
}

void Membership::Balance(absl::Time now) {
  if (now < next_move_) return;
  const std::optional<WorkerMove> move = FindMove(members(), options_.owner.epoch);
  if (!move.has_value()) return;
  next_move_ = now + options_.lease * kLeasesPerMove;
  options_.log->info("event=workers_moved workers={} to={}", move->workers, move->address);
  host_->MoveWorkers(*move);
}

}  // namespace lumifold::cluster
