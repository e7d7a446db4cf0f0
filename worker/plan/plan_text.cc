#include "worker/plan/plan_text.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "nlohmann/json.hpp"

namespace lumifold::plan {

std::string PlanTable(const Plan& plan) {
  size_t name_width = 0;
  for (const Decision& decision : plan.decisions) name_width = std::max(name_width, decision.name.size());
  const int width = static_cast<int>(name_width);
  std::string table = absl::StrFormat("%-*s  %-5s  %-6s  %s\n", width, "DECISION", "VALUE", "BY", "REASON");
  for (const Decision& d : plan.decisions) {
    absl::StrAppendFormat(&table, "%-*s  %-5s  %-6s  %s", width, d.name, d.value, NameOf(d.source), d.reason);
    if (!d.saving.empty()) absl::StrAppend(&table, " (saves ", d.saving, ")");
    table += '\n';
  }
  absl::StrAppendFormat(&table,
                        "The probe traced %d rays: about %.2g s of one thread. A sample of every pixel takes "
                        "about %.2g s; its relative variance is %.2g.\n",
                        plan.probe_rays, plan.probe_seconds, plan.seconds_per_sample, plan.noise);
  return table;
}

std::string PlanJson(const Plan& plan) {
  nlohmann::ordered_json decisions = nlohmann::ordered_json::array();
  for (const Decision& d : plan.decisions) {
    decisions.push_back({{"name", d.name},
                         {"value", d.value},
                         {"by", NameOf(d.source)},
                         {"reason", d.reason},
                         {"saving", d.saving},
                         {"governs", d.governs}});
  }
  const nlohmann::ordered_json json = {{"decisions", std::move(decisions)},
                                       {"tile_order", plan.units.tile_order},
                                       {"probe_rays", plan.probe_rays},
                                       {"probe_seconds", plan.probe_seconds},
                                       {"seconds_per_sample", plan.seconds_per_sample},
                                       {"noise", plan.noise}};
  return json.dump(-1, ' ', /*ensure_ascii=*/true, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

}  // namespace lumifold::plan
