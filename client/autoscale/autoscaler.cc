#include "client/autoscale/autoscaler.h"

#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "proto/logging/fields.h"
#include "spdlog/spdlog.h"

namespace lumifold::autoscale {

Autoscaler::Autoscaler(AutoscalerOptions options, History history, Engine* engine)
    : options_(std::move(options)), history_(std::move(history)), engine_(engine) {}

absl::StatusOr<Decision> Autoscaler::Step() {
  const absl::StatusOr<FarmState> farm = options_.read_farm();
  if (!farm.ok()) return farm.status();
  const absl::StatusOr<EngineState> seen = engine_->Snapshot();
  // For the exit code: "unavailable" is the coordinator.
  if (!seen.ok()) return absl::InternalError(seen.status().message());
  Decision decision = Decide(options_.now(), *farm, *seen, options_.limits, options_.tuning, &history_);
  Log(decision);
  if (options_.dry_run) return decision;
  Act(*seen, decision);
  if (absl::Status status = options_.keep(history_); !status.ok())
    return absl::InternalError(status.message());
  return decision;
}

void Autoscaler::Act(const EngineState& seen, const Decision& decision) {
  if (!decision.release.empty()) {
    std::vector<std::string> ids;
    for (const Release& release : decision.release) {
      ids.push_back(release.id);
      options_.log->info("event=release request={} why={}", logging::Quoted(release.id),
                         logging::Quoted(release.why));
    }
    if (const absl::Status status = engine_->Release(seen, ids); !status.ok())
      options_.log->warn("event=release_failed error={}", logging::Quoted(status.message()));
  }
  if (decision.start == 0) return;
  const absl::Status status = engine_->Start(seen, decision.start);
  if (status.ok()) {
    OnStarted(&history_);
    options_.log->info("event=start workers={}", decision.start);
  } else {
    OnRefused(options_.now(), std::string(status.message()), &history_);
    options_.log->warn("event=start_refused failures={} error={}", history_.refusals.failures,
                       logging::Quoted(status.message()));
  }
}

void Autoscaler::Log(const Decision& decision) {
  const bool acts = decision.start > 0 || !decision.release.empty();
  const auto level = acts || decision.reason != last_logged_ ? spdlog::level::info : spdlog::level::debug;
  options_.log->log(
      level, "event=step wanted={} running={} pending={} start={} release={} core_hours={:.3f} reason={}",
      decision.wanted, decision.running, decision.pending, decision.start, decision.release.size(),
      history_.UsedCoreSeconds() / absl::ToDoubleSeconds(absl::Hours(1)), logging::Quoted(decision.reason));
  last_logged_ = decision.reason;
}

std::string DecisionJson(const Decision& decision) {
  nlohmann::json release = nlohmann::json::array();
  for (const Release& one : decision.release) release.push_back({{"id", one.id}, {"why", one.why}});
  const nlohmann::ordered_json json = {{"wanted", decision.wanted},   {"pending", decision.pending},
                                       {"running", decision.running}, {"start", decision.start},
                                       {"release", release},          {"reason", decision.reason}};
  return json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

std::string DecisionText(const Decision& decision) {
  std::string text = decision.reason + "\n";
  for (const Release& release : decision.release)
    absl::StrAppend(&text, "release ", release.id, ": ", release.why, "\n");
  return text;
}

}  // namespace lumifold::autoscale
