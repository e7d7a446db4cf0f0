#include "client/reports/job_report.h"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/time/time.h"
#include "client/cli/json_line.h"
#include "client/cli/progress.h"
#include "client/cli/suggestion.h"
#include "client/reports/job_settings.h"
#include "proto/rpc/bounded_text.h"

namespace lumifold::client {
namespace {

struct NamedState {
  v1::JobState state;
  absl::string_view name;
};
constexpr std::array<NamedState, 9> kStates = {{{v1::JOB_STATE_SUBMITTED, "submitted"},
                                                {v1::JOB_STATE_PLANNED, "planned"},
                                                {v1::JOB_STATE_RUNNING, "running"},
                                                {v1::JOB_STATE_PAUSED, "paused"},
                                                {v1::JOB_STATE_FILTERING, "filtering"},
                                                {v1::JOB_STATE_DONE, "done"},
                                                {v1::JOB_STATE_DONE_WITH_GAPS, "done-with-gaps"},
                                                {v1::JOB_STATE_FAILED, "failed"},
                                                {v1::JOB_STATE_CANCELLED, "cancelled"}}};

std::string SubmittedText(const v1::JobStatus& status) {
  return absl::FormatTime("%Y-%m-%dT%H:%M:%SZ", absl::FromUnixMillis(status.submitted_unix_ms()),
                          absl::UTCTimeZone());
}

/// By samples, as the status page counts: geometry units are many and short.
int PercentDone(const v1::JobStatus& status) {
  if (IsDone(status)) return 100;
  if (status.samples_total() <= 0) return 0;
  return static_cast<int>(std::min<int64_t>(100 * status.samples_done() / status.samples_total(), 100));
}

std::string WebhookStateName(v1::WebhookDelivery::State state) {
  switch (state) {
    case v1::WebhookDelivery::STATE_DELIVERED:
      return "delivered";
    case v1::WebhookDelivery::STATE_GIVEN_UP:
      return "given up";
    default:
      return "waiting";
  }
}

/// "https://..., delivered, tries 2"; of a job that has a webhook.
std::string WebhookText(const v1::JobStatus& status) {
  std::string text = rpc::Printable(status.scheduling().webhook());
  if (!status.has_webhook()) return text;
  const v1::WebhookDelivery& delivery = status.webhook();
  absl::StrAppend(&text, ", ", WebhookStateName(delivery.state()), ", tries ", delivery.tries());
  if (!delivery.error().empty()) absl::StrAppend(&text, ", last failure: ", rpc::Printable(delivery.error()));
  return text;
}

nlohmann::ordered_json WebhookJson(const v1::JobStatus& status) {
  nlohmann::ordered_json json{{"url", status.scheduling().webhook()}};
  if (!status.has_webhook()) return json;
  const v1::WebhookDelivery& delivery = status.webhook();
  json["state"] = WebhookStateName(delivery.state());
  json["delivery_id"] = delivery.delivery_id();
  json["tries"] = delivery.tries();
  json["error"] = delivery.error();
  return json;
}

/// "0.83 MSE255, target 0.5 not reached: ..."; of a status with an estimated error.
std::string ErrorText(const v1::JobStatus& status) {
  const v1::AdaptiveSampling& adaptive = status.adaptive();
  const bool is_relative = adaptive.metric() == v1::ERROR_METRIC_REL_MSE;
  std::string text = absl::StrFormat("%.3g %s", status.estimated_error(), is_relative ? "relMSE" : "MSE255");
  if (adaptive.target_error() > 0) absl::StrAppendFormat(&text, ", target %.3g", adaptive.target_error());
  const bool is_reached = status.estimated_error() <= adaptive.target_error();
  if (adaptive.target_error() > 0 && IsDone(status) && !is_reached)
    absl::StrAppend(&text, " not reached: another limit ended sampling");
  return text;
}

}  // namespace

absl::string_view StateName(v1::JobState state) {
  const auto found = std::find_if(kStates.begin(), kStates.end(),
                                  [state](const NamedState& named) { return named.state == state; });
  return found == kStates.end() ? "unknown" : found->name;
}

absl::StatusOr<v1::JobState> ParseStateName(absl::string_view name) {
  std::vector<std::string> names;
  for (const NamedState& named : kStates) {
    if (named.name == name) return named.state;
    names.emplace_back(named.name);
  }
  return absl::InvalidArgumentError(
      absl::StrCat("no state '", name, "'; there are ", absl::StrJoin(names, ", "), Suggestion(name, names)));
}

bool IsDone(const v1::JobStatus& status) {
  return status.state() == v1::JOB_STATE_DONE || status.state() == v1::JOB_STATE_DONE_WITH_GAPS;
}

bool HasEnded(const v1::JobStatus& status) {
  return IsDone(status) || status.state() == v1::JOB_STATE_FAILED ||
         status.state() == v1::JOB_STATE_CANCELLED;
}

std::vector<FrameRange> SkippedFrames(const v1::JobStatus& status) {
  std::vector<FrameRange> frames;
  for (const v1::FrameRange& range : status.scheduling().gaps().skipped())
    frames.push_back({range.first(), range.first() + range.count() - 1});
  return frames;
}

ExitCode ExitCodeForOutcome(const v1::JobStatus& status) {
  if (status.state() == v1::JOB_STATE_FAILED) return ExitCode::kFailed;
  if (status.state() == v1::JOB_STATE_CANCELLED) return ExitCode::kCancelled;
  if (status.state() == v1::JOB_STATE_DONE_WITH_GAPS) return ExitCode::kGaps;
  return ExitCode::kOk;
}

std::string StageTimesText(const v1::StageTimes& times) {
  return absl::StrFormat("render %.2f s, assemble %.2f s, filter %.2f s, write %.2f s",
                         times.render_seconds(), times.assemble_seconds(), times.filter_seconds(),
                         times.write_seconds());
}

std::string FilteringText(const v1::JobStatus& status) {
  if (status.frames_filtering() + status.frames_waiting() == 0) return "";
  const std::string waiting =
      status.frames_waiting() == 0 ? "" : absl::StrCat(", ", status.frames_waiting(), " waiting");
  return absl::StrCat(status.frames_filtering(), " in the filter", waiting);
}

std::string JobJson(const v1::JobStatus& status,
                    const std::vector<std::pair<std::string, std::string>>& more) {
  nlohmann::ordered_json json;
  json["job_id"] = status.job_id();
  json["state"] = std::string(StateName(status.state()));
  json["name"] = status.display_name();
  json["error"] = status.error();
  json["warnings"] = nlohmann::ordered_json::array();
  for (const std::string& warning : status.warnings()) json["warnings"].push_back(warning);
  json["submitted_unix_ms"] = status.submitted_unix_ms();
  json["workers"] = status.workers();
  json["units_done"] = status.units_done();
  json["units_total"] = status.units_total();
  json["frames_done"] = status.frames_done();
  json["frames_total"] = status.frames_total();
  if (status.frames_skipped() > 0) json["frames_skipped"] = status.frames_skipped();
  const std::vector<FrameRange> skipped = SkippedFrames(status);
  if (!skipped.empty()) json["skipped"] = TextOf(skipped);
  if (status.frames_filtering() > 0) json["frames_filtering"] = status.frames_filtering();
  if (status.frames_filtered() > 0) json["frames_filtered"] = status.frames_filtered();
  if (status.frames_waiting() > 0) json["frames_waiting"] = status.frames_waiting();
  json["samples_done"] = status.samples_done();
  json["samples_total"] = status.samples_total();
  json["bad_samples"] = status.bad_samples();
  json["render_seconds"] = status.times().render_seconds();
  json["assemble_seconds"] = status.times().assemble_seconds();
  json["filter_seconds"] = status.times().filter_seconds();
  json["write_seconds"] = status.times().write_seconds();
  const v1::Scheduling& scheduling = status.scheduling();
  if (status.width() > 0) {
    json["width"] = status.width();
    json["height"] = status.height();
    json["samples_per_pixel"] = status.samples_per_pixel();
  }
  if (status.has_settings()) json["options"] = SettingsJson(status);
  if (status.has_estimated_error()) json["estimated_error"] = status.estimated_error();
  json["user"] = scheduling.user();
  json["priority"] = scheduling.priority();
  json["tags"] = scheduling.tags();
  json["max_leases"] = scheduling.max_leases();
  json["after"] = scheduling.after();
  json["class"] = scheduling.numeric_class();
  json["audit_share"] = scheduling.audit_share();
  if (!scheduling.webhook().empty()) json["webhook"] = WebhookJson(status);
  if (!status.coordinator().empty()) json["coordinator"] = status.coordinator();
  if (!scheduling.trace_id().empty()) json["trace_id"] = scheduling.trace_id();
  for (const auto& [name, text] : more) json[name] = text;
  return JsonLine(json);
}

std::string JobText(const v1::JobStatus& status) {
  std::string text;
  const auto line = [&text](absl::string_view name, const auto&... value) {
    absl::StrAppend(&text, name, ": ", value..., "\n");
  };
  line("job", status.job_id());
  line("state", StateName(status.state()));
  line("scene", rpc::Printable(status.display_name()));
  if (!status.error().empty()) line("error", status.error());
  for (const std::string& warning : status.warnings()) line("warning", warning);
  line("submitted", SubmittedText(status));
  const v1::Scheduling& scheduling = status.scheduling();
  if (!scheduling.user().empty()) line("user", rpc::Printable(scheduling.user()));
  line("priority", scheduling.priority());
  if (scheduling.tags_size() > 0) line("tags", rpc::Printable(absl::StrJoin(scheduling.tags(), ", ")));
  if (scheduling.max_leases() > 0) line("max leases", scheduling.max_leases());
  if (scheduling.after_size() > 0) line("after", absl::StrJoin(scheduling.after(), ", "));
  if (!scheduling.webhook().empty()) line("webhook", WebhookText(status));
  if (!status.coordinator().empty()) line("coordinator", status.coordinator());
  if (!scheduling.trace_id().empty()) line("trace", scheduling.trace_id());
  if (status.width() > 0) {
    line("size", status.width(), "x", status.height());
    line("samples per pixel", status.samples_per_pixel());
  }
  if (status.has_settings()) line("options", SettingsText(status));
  line("workers", status.workers());
  line("units", status.units_done(), " of ", status.units_total());
  const std::string filtering = FilteringText(status);
  line("frames", status.frames_done(), " of ", status.frames_total(), filtering.empty() ? "" : ", ",
       filtering);
  if (status.frames_skipped() > 0) line("skipped", TextOf(SkippedFrames(status)));
  line("samples", status.samples_done(), " of ", status.samples_total());
  if (status.bad_samples() > 0) line("bad samples", status.bad_samples());
  if (status.has_estimated_error()) line("estimated error", ErrorText(status));
  line("stages", StageTimesText(status.times()));
  return text;
}

std::string JobTableHead() {
  return absl::StrFormat("%-20s %-14s %5s  %-20s %8s  %-12s %s\n", "JOB", "STATE", "DONE", "SUBMITTED",
                         "TIME", "USER", "NAME");
}

std::string JobTableLine(const v1::JobStatus& status) {
  const double seconds = status.times().render_seconds();
  std::string error = rpc::Printable(status.error());
  if (!error.empty()) error.insert(0, "  error: ");
  return absl::StrFormat(
      "%-20s %-14s %4d%%  %-20s %8s  %-12s %s%s\n", status.job_id(), StateName(status.state()),
      PercentDone(status), SubmittedText(status), seconds > 0 ? DurationText(absl::Seconds(seconds)) : "-",
      rpc::Printable(status.scheduling().user()), rpc::Printable(status.display_name()), error);
}

}  // namespace lumifold::client
