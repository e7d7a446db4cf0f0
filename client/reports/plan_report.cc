#include "client/reports/plan_report.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "filter/image/decisions.h"
#include "proto/rpc/plan_text.h"

#include "client/cli/json_line.h"

namespace lumifold::client {

std::string PlanTable(const v1::Plan& plan) {
  size_t name_width = 0;
  for (const v1::PlanDecision& decision : plan.decisions())
    name_width = std::max(name_width, decision.name().size());
  const int width = static_cast<int>(name_width);
  std::string table = absl::StrFormat("%-*s  %-5s  %-6s  %s\n", width, "DECISION", "VALUE", "BY", "REASON");
  for (const v1::PlanDecision& d : plan.decisions()) {
    absl::StrAppendFormat(&table, "%-*s  %-5s  %-6s  %s", width, d.name(), rpc::ValueText(d),
                          std::string(rpc::NameOf(d.source())), d.reason());
    if (!d.saving().empty()) absl::StrAppend(&table, " (saves ", d.saving(), ")");
    table += '\n';
  }
  if (plan.memory_bytes() > 0)
    absl::StrAppendFormat(&table, "A worker needs about %.1f GiB of memory for the scene.\n",
                          static_cast<double>(plan.memory_bytes()) / (1 << 30));
  if (plan.probe_rays() == 0) return table;
  absl::StrAppendFormat(&table,
                        "The probe traced %d rays: about %.2g s of one thread. A sample of every pixel takes "
                        "about %.2g s; its relative variance is %.2g.\n",
                        plan.probe_rays(), plan.probe_seconds(), plan.seconds_per_sample(), plan.noise());
  return table;
}

std::string PlanJson(const v1::Plan& plan) {
  nlohmann::ordered_json decisions = nlohmann::ordered_json::array();
  for (const v1::PlanDecision& d : plan.decisions()) {
    const decisions::Decision* const known = decisions::Find(d.name());
    decisions.push_back({{"name", d.name()},
                         {"value", rpc::ValueText(d)},
                         {"by", std::string(rpc::NameOf(d.source()))},
                         {"reason", d.reason()},
                         {"saving", d.saving()},
                         {"governs", known == nullptr ? "" : std::string(known->governs)}});
  }
  nlohmann::ordered_json json = {{"decisions", std::move(decisions)},
                                 {"tile_order", nlohmann::ordered_json::array()},
                                 {"probe_rays", plan.probe_rays()},
                                 {"probe_seconds", plan.probe_seconds()},
                                 {"seconds_per_sample", plan.seconds_per_sample()},
                                 {"noise", plan.noise()},
                                 {"memory_bytes", plan.memory_bytes()}};
  for (const int32_t tile : plan.tile_order()) json["tile_order"].push_back(tile);
  return JsonLine(json);
}

}  // namespace lumifold::client
