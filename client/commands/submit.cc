#include "client/submit_scene.h"

#include <nlohmann/json.hpp>
#include <utility>

#include "client/assets.h"
#include "client/commands/commands.h"
#include "client/commands/shared_options.h"
#include "client/job_options.h"
#include "client/scheduling_options.h"
#include "proto/rpc/trace_context.h"

namespace lumifold::client {
namespace {

absl::StatusOr<std::string> Submit(const JobOptions& job, const SchedulingOptions& scheduling,
                                   const RemoteOptions& remote, const Environment& environment) {
  const absl::StatusOr<SceneAssets> assets = FindJobAssets(job);
  if (!assets.ok()) return assets.status();
  const std::unique_ptr<FarmClient> farm = remote.Connect(environment);
  const std::unique_ptr<Progress> progress = MakeProgressPrinter(environment);
  v1::SubmitJobRequest request;
  *request.mutable_spec() = MakeJobSpec(job);
  *request.mutable_scheduling() = scheduling.ToProto();
  return SubmitScene(*farm, *assets, std::move(request), *progress, MakeBackoff(environment));
}

}  // namespace

ExitCode RunSubmit(const std::vector<std::string>& arguments, const Environment& environment) {
  JobOptions job;
  SchedulingOptions scheduling(environment);
  RemoteOptions remote(environment);
  CommandLine command_line("submit", SummaryOf("submit"));
  AddJobOptions(command_line, &job);
  scheduling.AddTo(command_line);
  remote.AddTo(command_line);
  if (const auto ended = command_line.Parse(arguments, environment)) return *ended;
  if (const auto ended = CheckJobOptions(job, "lumifold submit", environment)) return *ended;

  const absl::StatusOr<std::string> job_id = Submit(job, scheduling, remote, environment);
  if (!job_id.ok()) return ReportError(environment, job_id.status());
  nlohmann::ordered_json json{{"job_id", *job_id}};
  if (const std::string trace_id = rpc::TraceIdOf(environment.trace_parent); !trace_id.empty())
    json["trace_id"] = trace_id;
  environment.out << (remote.json ? json.dump() : *job_id) << "\n" << std::flush;
  return ExitCode::kOk;
}

}  // namespace lumifold::client
