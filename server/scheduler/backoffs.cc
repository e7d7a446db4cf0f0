#include "server/scheduler/backoffs.h"

#include <algorithm>
#include <iterator>

namespace lumifold::scheduler {

void Backoffs::Begin(const UnitIndex& unit, absl::Time end) {
  End(unit);
  by_end_.emplace(end, unit);
  by_unit_.emplace(unit, end);
}

void Backoffs::End(const UnitIndex& unit) {
  const auto pause = by_unit_.find(unit);
  if (pause == by_unit_.end()) return;
  by_end_.erase({pause->second, unit});
  by_unit_.erase(pause);
}

std::vector<UnitIndex> Backoffs::TakeEnded(absl::Time now) {
  std::vector<UnitIndex> ended;
  while (!by_end_.empty() && by_end_.begin()->first <= now) {
    ended.push_back(by_end_.begin()->second);
    by_end_.erase(by_end_.begin());
    by_unit_.erase(ended.back());
  }
  return ended;
}

absl::Time Backoffs::NextEnd() const {
  return by_end_.empty() ? absl::InfiniteFuture() : by_end_.begin()->first;
}

int64_t Backoffs::CountOf(int64_t job) const {
  return std::distance(by_unit_.lower_bound({job, {}}), by_unit_.lower_bound({job + 1, {}}));
}

std::optional<Backoffs::Pause> Backoffs::LongestOf(int64_t job) const {
  const auto end = by_unit_.lower_bound({job + 1, {}});
  const auto longest = std::max_element(by_unit_.lower_bound({job, {}}), end,
                                        [](const auto& a, const auto& b) { return a.second < b.second; });
  return longest == end ? std::nullopt : std::optional(Pause{longest->first.place, longest->second});
}

void Backoffs::ForgetJob(int64_t job) {
  std::erase_if(by_end_, [job](const auto& entry) { return entry.second.job == job; });
  by_unit_.erase(by_unit_.lower_bound({job, {}}), by_unit_.lower_bound({job + 1, {}}));
}

}  // namespace lumifold::scheduler
