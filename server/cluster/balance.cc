#include "server/cluster/balance.h"

#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

namespace lumifold::cluster {
namespace {

using ledger::Member;

/// A job that has not reached the figures yet counts as one.
double JobsOf(const Member& member) { return static_cast<double>(std::max<int64_t>(1, member.active_jobs)); }

/// Slots of each job where all slots are given out and nobody gets more than it demands: members are served
/// in the order in which they are satisfied.
double SlotsPerJob(absl::Span<const Member> members) {
  std::vector<const Member*> wanting;
  double slots = 0;
  double jobs = 0;
  for (const Member& member : members) {
    slots += static_cast<double>(member.slots);
    if (member.demand == 0) continue;
    wanting.push_back(&member);
    jobs += JobsOf(member);
  }
  const auto enough = [](const Member* member) {
    return static_cast<double>(member->demand) / JobsOf(*member);
  };
  std::sort(wanting.begin(), wanting.end(),
            [&enough](const Member* a, const Member* b) { return enough(a) < enough(b); });
  for (const Member* member : wanting) {
    if (enough(member) * jobs >= slots) return slots / jobs;
    slots -= static_cast<double>(member->demand);
    jobs -= JobsOf(*member);
  }
  return std::numeric_limits<double>::infinity();  // with more slots than demand the rest stays where it is
}

/// It has units to render and nobody who could.
bool Starves(const Member& member) { return member.demand > 0 && member.slots == 0; }

}  // namespace

std::optional<WorkerMove> FindMove(absl::Span<const Member> members, ledger::Epoch self) {
  const double per_job = SlotsPerJob(members);
  const auto surplus = [per_job](const Member& member) {
    return static_cast<double>(member.slots) -
           std::min(static_cast<double>(member.demand), per_job * JobsOf(member));
  };
  const auto is_poorer = [&surplus](const Member& a, const Member& b) {
    return std::pair(!Starves(a), surplus(a)) < std::pair(!Starves(b), surplus(b));
  };
  const Member* giver = nullptr;
  const Member* poorest = nullptr;
  const Member* richest = nullptr;  // of those that can do without a worker
  for (const Member& member : members) {
    const bool is_self = member.owner.epoch == self;
    if (is_self) giver = &member;
    if (!is_self && (poorest == nullptr || is_poorer(member, *poorest))) poorest = &member;
    const bool can_spare = member.workers > (member.demand > 0 ? 1 : 0);
    if (can_spare && (richest == nullptr || surplus(member) > surplus(*richest))) richest = &member;
  }
  if (giver == nullptr || poorest == nullptr || giver->workers == 0 || surplus(*poorest) >= 0)
    return std::nullopt;
  const double slots_of_worker =
      std::max(1.0, static_cast<double>(giver->slots) / static_cast<double>(giver->workers));
  // A lack of less than half a worker would become a surplus elsewhere, and workers would wander.
  const double spare = surplus(*giver) / slots_of_worker;
  const double lack = -surplus(*poorest) / slots_of_worker + 0.5;
  auto workers = static_cast<int64_t>(std::min(spare, lack));
  // A share of less than a worker would be none: one comes from the coordinator that it costs least.
  if (Starves(*poorest) && giver == richest) workers = std::max<int64_t>(workers, 1);
  if (workers < 1) return std::nullopt;
  return WorkerMove{std::min(workers, giver->workers), poorest->address};
}

}  // namespace lumifold::cluster
