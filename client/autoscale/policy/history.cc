#include "client/autoscale/policy/history.h"

#include <algorithm>

#include "absl/strings/str_cat.h"

namespace lumifold::autoscale {
namespace {

/// One life of a request: a requeued Slurm job has several.
std::string LifeOf(const Request& request) {
  return absl::StrCat(request.id, "/", absl::ToUnixSeconds(request.started));
}

bool HasStarted(const Request& request) { return request.started != absl::InfiniteFuture(); }

bool DiedAtStart(const Request& request, const Tuning& tuning, const History& history) {
  if (request.state != Request::State::kEnded || request.ended - request.started > tuning.start_time)
    return false;
  // A worker ends with success where it was told to leave or was idle: then it had joined.
  return request.end == Request::End::kFailed ||
         (request.end == Request::End::kLeft && !history.seen.joined.contains(request.id));
}

void StartPeriod(absl::Time now, const Limits& limits, History* history) {
  const absl::Duration period = limits.budget_period;
  const absl::Time start = period == absl::InfiniteDuration()
                               ? absl::UnixEpoch()
                               : absl::UnixEpoch() + absl::Floor(now - absl::UnixEpoch(), period);
  if (start == history->period_start) return;
  history->period_start = start;
  history->spent_core_seconds = 0;
  for (auto& [id, charge] : history->charges) {
    charge.from = std::max(charge.from, start);
    charge.until = std::max(charge.until, charge.from);
  }
}

}  // namespace

void Backoff::Fail(absl::Time now, const std::string& reason) {
  ++failures;
  last = now;
  why = reason;
}

absl::Time Backoff::NextTry(const Tuning& tuning) const {
  if (failures == 0) return absl::InfinitePast();
  return last + tuning.pauses.After(failures);
}

double History::UsedCoreSeconds() const {
  double used = spent_core_seconds;
  for (const auto& [id, charge] : charges) used += charge.CoreSeconds();
  return used;
}

void ChargeRequests(absl::Time now, const EngineState& engine, const Limits& limits, History* history) {
  StartPeriod(now, limits, history);
  std::map<std::string, Charge> charges;
  for (const Request& request : engine.requests) {
    const bool ended = request.state == Request::State::kEnded;
    const std::string life = LifeOf(request);
    if (!HasStarted(request) || (ended && history->counted_ends.contains(life))) continue;
    const absl::Time from = std::max(request.started, history->period_start);
    charges[life] = {.cores = request.cores,
                     .from = from,
                     .until = std::max(from, ended ? std::min(request.ended, now) : now)};
  }
  for (auto& [life, charge] : history->charges) {
    if (charges.contains(life) || history->counted_ends.contains(life)) continue;
    charge.until = std::max(charge.until, now);
    history->spent_core_seconds += charge.CoreSeconds();
  }
  history->charges = std::move(charges);
}

void CountDeaths(absl::Time now, const EngineState& engine, const Tuning& tuning, History* history) {
  std::set<std::string> counted;
  int deaths = 0;
  absl::Time last_death = absl::InfinitePast();
  std::string why;
  for (const Request& request : engine.requests) {
    const std::string life = LifeOf(request);
    const bool lives = request.state == Request::State::kRunning;
    if (lives && request.started > history->deaths.last && now - request.started > tuning.start_time)
      history->deaths = Backoff();
    if (request.state != Request::State::kEnded) continue;
    counted.insert(life);
    if (history->counted_ends.contains(life)) continue;
    if (const auto charge = history->charges.find(life); charge != history->charges.end()) {
      history->spent_core_seconds += charge->second.CoreSeconds();
      history->charges.erase(charge);
    }
    if (!DiedAtStart(request, tuning, *history)) continue;
    ++deaths;
    last_death = std::max(last_death, std::min(request.ended, now));
    why =
        absl::StrCat("request ", request.id, " ended ", absl::FormatDuration(request.ended - request.started),
                     " after its start", request.detail.empty() ? "" : ": ", request.detail);
  }
  history->counted_ends = std::move(counted);
  if (deaths > 1) absl::StrAppend(&why, " (and ", deaths - 1, " more)");
  if (deaths > 0) history->deaths.Fail(last_death, why);
}

}  // namespace lumifold::autoscale
