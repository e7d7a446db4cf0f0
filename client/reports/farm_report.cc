#include "client/reports/farm_report.h"

#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/time/time.h"
#include "client/cli/json_line.h"
#include "client/reports/job_report.h"
#include "client/reports/plan_report.h"
#include "proto/rpc/bounded_text.h"

namespace lumifold::client {
namespace {

std::string UtcTimeText(int64_t unix_ms) {
  return absl::FormatTime("%Y-%m-%dT%H:%M:%E3SZ", absl::FromUnixMillis(unix_ms), absl::UTCTimeZone());
}

std::string CoordinatorColumn(absl::string_view text) { return absl::StrFormat("%-16s ", text); }

}  // namespace

absl::string_view WorkerStateName(v1::WorkerState state) {
  switch (state) {
    case v1::WORKER_STATE_IDLE:
      return "idle";
    case v1::WORKER_STATE_BUSY:
      return "busy";
    case v1::WORKER_STATE_DRAINING:
      return "draining";
    case v1::WORKER_STATE_SILENT:
      return "silent";
    case v1::WORKER_STATE_SET_ASIDE:
      return "set aside";
    case v1::WORKER_STATE_BLOCKED:
      return "blocked";
    case v1::WORKER_STATE_RESTING:
      return "resting";
    case v1::WORKER_STATE_GONE:
      return "gone";
    default:
      return "unknown";
  }
}

std::string WorkerTableHead(bool of_several) {
  return absl::StrFormat("%-8s %-24s %-9s %6s %6s %8s %6s %7s  %s%s\n", "WORKER", "NAME", "STATE", "LEASES",
                         "SLOTS", "DONE", "FAILED", "S/UNIT",
                         of_several ? CoordinatorColumn("COORDINATOR") : "", "REASON");
}

std::string WorkerTableLine(const v1::WorkerStatus& worker, bool of_several) {
  const bool has_two_names = !worker.process().empty() && worker.process() != worker.name();
  return absl::StrFormat(
      "%-8s %-24s %-9s %6d %6d %8d %6d %7.2f  %s%s\n", worker.worker_id().empty() ? "-" : worker.worker_id(),
      rpc::Printable(has_two_names ? absl::StrCat(worker.name(), "/", worker.process()) : worker.name()),
      WorkerStateName(worker.state()), worker.leases(), worker.slots(), worker.units_done(),
      worker.units_failed(), worker.seconds_per_unit(),
      of_several ? CoordinatorColumn(worker.coordinator().empty() ? "-" : worker.coordinator()) : "",
      rpc::Printable(worker.reason()));
}

std::string HistoryText(const v1::WorkerStatus& worker) {
  std::string text;
  if (worker.history_size() > 0) {
    text = absl::StrFormat("\n%-20s %6s  %-24s  %-24s %6s %6s %9s\n", "JOB", "FRAME", "FIRST UNIT",
                           "LAST UNIT", "UNITS", "FAILED", "SECONDS");
  }
  for (const v1::FrameOfWorker& frame : worker.history()) {
    absl::StrAppendFormat(&text, "%-20s %6d  %-24s  %-24s %6d %6d %9.1f\n", frame.job_id(), frame.frame(),
                          UtcTimeText(frame.first_unix_ms()), UtcTimeText(frame.last_unix_ms()),
                          frame.units(), frame.failed(), frame.seconds());
  }
  return text;
}

std::string WorkerJson(const v1::WorkerStatus& worker) {
  nlohmann::ordered_json json;
  json["worker_id"] = worker.worker_id();
  json["name"] = worker.name();
  json["process"] = worker.process();
  json["state"] = std::string(WorkerStateName(worker.state()));
  json["reason"] = worker.reason();
  json["class"] = worker.numeric_class();
  json["tags"] = worker.tags();
  json["slots"] = worker.slots();
  json["leases"] = worker.leases();
  json["units_done"] = worker.units_done();
  json["units_failed"] = worker.units_failed();
  json["seconds_per_unit"] = worker.seconds_per_unit();
  json["connected_unix_ms"] = worker.connected_unix_ms();
  json["job_ids"] = worker.job_ids();
  json["memory_bytes"] = worker.memory_bytes();
  if (!worker.coordinator().empty()) json["coordinator"] = worker.coordinator();
  for (const v1::FrameOfWorker& frame : worker.history()) {
    json["history"].push_back({{"job_id", frame.job_id()},
                               {"frame", frame.frame()},
                               {"first_unix_ms", frame.first_unix_ms()},
                               {"last_unix_ms", frame.last_unix_ms()},
                               {"units", frame.units()},
                               {"failed", frame.failed()},
                               {"seconds", frame.seconds()}});
  }
  return JsonLine(json);
}

std::string ExplanationText(const v1::ExplainJobResponse& explanation) {
  std::string text = absl::StrCat("job: ", explanation.status().job_id(),
                                  "\nstate: ", StateName(explanation.status().state()), "\n");
  for (const v1::Reason& reason : explanation.reasons())
    absl::StrAppend(&text, reason.code(), ": ", reason.text(), "\n");
  if (explanation.reasons().empty()) absl::StrAppend(&text, "nothing holds it up\n");
  if (explanation.has_plan()) absl::StrAppend(&text, "\n", PlanTable(explanation.plan()));
  return text;
}

std::string ExplanationJson(const v1::ExplainJobResponse& explanation) {
  nlohmann::ordered_json json;
  json["job_id"] = explanation.status().job_id();
  json["state"] = std::string(StateName(explanation.status().state()));
  const std::string& trace_id = explanation.status().scheduling().trace_id();
  if (!trace_id.empty()) json["trace_id"] = trace_id;
  json["reasons"] = nlohmann::ordered_json::array();
  for (const v1::Reason& reason : explanation.reasons())
    json["reasons"].push_back({{"code", reason.code()}, {"text", reason.text()}});
  if (explanation.has_plan()) json["plan"] = nlohmann::ordered_json::parse(PlanJson(explanation.plan()));
  return JsonLine(json);
}

std::string LogEventLine(const v1::LogEvent& event) {
  return absl::StrCat(absl::StrFormat("%s %-5s ", UtcTimeText(event.unix_ms()), event.level()),
                      event.worker().empty() ? "" : absl::StrCat(event.worker(), ": "), event.text(), "\n");
}

std::string LogEventJson(const v1::LogEvent& event) {
  nlohmann::ordered_json json{{"unix_ms", event.unix_ms()}, {"level", event.level()}};
  if (!event.worker().empty()) json["worker"] = event.worker();
  json["text"] = event.text();
  return JsonLine(json);
}

std::string ServerStatusText(const v1::ServerStatus& status) {
  std::string text;
  const auto line = [&text](absl::string_view name, const auto&... value) {
    absl::StrAppend(&text, name, ": ", value..., "\n");
  };
  line("version", status.version());
  line("storage", status.storage_error().empty() ? "ok" : status.storage_error());
  if (status.storage_error_since_unix_ms() > 0)
    line("storage failed at", UtcTimeText(status.storage_error_since_unix_ms()));
  line("free", absl::StrFormat("%.1f GB", static_cast<double>(status.free_bytes()) * 1e-9));
  line("workers", status.workers());
  line("leases", status.leases(), ", slots ", status.slots());
  line("active jobs", status.active_jobs());
  line("frames in flight", status.frames_in_flight());
  line("encrypted", status.insecure() ? "no" : "yes");
  if (const v1::WebhookCounts& webhooks = status.webhooks(); status.has_webhooks()) {
    line("webhooks", webhooks.waiting(), " waiting, ", webhooks.delivered(), " delivered, ",
         webhooks.failed(), " failed tries, ", webhooks.given_up(), " given up");
  }
  for (const v1::CoordinatorStatus& one : status.coordinators()) {
    line("coordinator", one.name(), " at ", one.address(), ", epoch ", one.epoch(), ": active jobs ",
         one.active_jobs(), ", workers ", one.workers(), ", slots ", one.slots(), ", demand ", one.demand());
  }
  return text;
}

std::string ServerStatusJson(const v1::ServerStatus& status) {
  nlohmann::ordered_json json;
  json["version"] = status.version();
  json["storage_error"] = status.storage_error();
  json["storage_error_since_unix_ms"] = status.storage_error_since_unix_ms();
  json["free_bytes"] = status.free_bytes();
  json["workers"] = status.workers();
  json["slots"] = status.slots();
  json["leases"] = status.leases();
  json["active_jobs"] = status.active_jobs();
  json["frames_in_flight"] = status.frames_in_flight();
  json["insecure"] = status.insecure();
  if (const v1::WebhookCounts& webhooks = status.webhooks(); status.has_webhooks()) {
    json["webhooks"] = {{"waiting", webhooks.waiting()},
                        {"delivered", webhooks.delivered()},
                        {"failed", webhooks.failed()},
                        {"given_up", webhooks.given_up()}};
  }
  for (const v1::CoordinatorStatus& one : status.coordinators()) {
    json["coordinators"].push_back({{"name", one.name()},
                                    {"address", one.address()},
                                    {"epoch", one.epoch()},
                                    {"active_jobs", one.active_jobs()},
                                    {"workers", one.workers()},
                                    {"slots", one.slots()},
                                    {"demand", one.demand()}});
  }
  return JsonLine(json);
}

}  // namespace lumifold::client
