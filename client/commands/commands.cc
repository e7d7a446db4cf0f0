#include "client/commands/commands.h"

#include <algorithm>

#include "client/cli/command_line.h"
#include "filter/image/check.h"

namespace lumifold::client {

const std::vector<Command>& Commands() {
  static const auto* const commands = new std::vector<Command>{
      {"render", "Render a scene on this machine and write the picture", RunRender},
      {"plan", "Print what a scene needs modelled, and why", RunPlan},
      {"submit", "Submit a scene to a coordinator and print the job's id", RunSubmit},
      {"status", "Print the status of a job", RunStatus},
      {"wait", "Wait until a job has ended, without showing progress", RunWait},
      {"watch", "Show a job's progress until it has ended", RunWatch},
      {"page", "Print a link to the coordinator's status page", RunPage},
      {"list", "List the coordinator's jobs, newest first", RunList},
      {"explain", "Say why a job does not run, or runs slowly", RunExplain},
      {"logs", "Print the last events of a job or a worker", RunLogs},
      {"pause", "Render no more units of a job until it is resumed", RunPause},
      {"resume", "Let a paused job go on", RunResume},
      {"move-to-front", "Render a job before its user's others", RunMoveToFront},
      {"set-priority", "Change the priority of a job", RunSetPriority},
      {"add-samples", "Give a job more samples per pixel", RunAddSamples},
      {"retry", "Render parts of a job again, or go on with a failed one", RunRetry},
      {"cancel", "Stop a job", RunCancel},
      {"delete", "Delete a job that has ended, and its pictures", RunDelete},
      {"download", "Download a finished frame of a job", RunDownload},
      {"workers", "List the workers", RunWorkers},
      {"drain", "Let a worker finish its units and leave", RunDrain},
      {"block", "Give a worker no units until it is readmitted", RunBlock},
      {"readmit", "Give a worker units again", RunReadmit},
      {"usage", "Print the core hours of users and jobs", RunUsage},
      {"server-status", "Print the state of the coordinator", RunServerStatus},
      {"login", "Get access to a coordinator with a code", RunLogin},
      {"logout", "Forget the access to a coordinator", RunLogout},
      {"whoami", "Print as whom the coordinator knows you", RunWhoAmI},
      {"invite", "Make a code for another person or a worker", RunInvite},
      {"identities", "List who has access: tokens, certificates, invites", RunIdentities},
      {"revoke", "Take the access of a person or a worker away", RunRevoke},
      {"filter", "Filter the noise of a picture that is already rendered", RunFilter},
      {"convert", "Write a layer of a picture as .png", RunConvert},
      {"compare", "Print the error of one picture against another", RunCompare},
      {"info", "Print what is in a scene or a picture", RunInfo},
      {"doctor", "Say what is wrong with this installation and its farm", RunDoctor,
       /*is_without_configuration=*/true},
      {"schema", "Print the JSON Schema of job files", RunSchema, /*is_without_configuration=*/true},
      {"completion", "Print a script that completes this command line in a shell", RunCompletion,
       /*is_without_configuration=*/true},
      {"man", "Print the manual page of a command", RunMan, /*is_without_configuration=*/true},
  };
  return *commands;
}

std::vector<CommandHelp> DescribeCommands(const Environment& environment) {
  std::vector<CommandHelp> all(Commands().size());
  for (size_t i = 0; i < all.size(); ++i) {
    Environment asks = environment;
    asks.description = &all[i];
    LUMIFOLD_CHECK(Commands()[i].run({}, asks) == ExitCode::kOk);
  }
  return all;
}

absl::StatusOr<OptionFile> ReadConfiguration(const Environment& environment) {
  absl::StatusOr<OptionFile> file =
      ReadOptionFile(environment.configuration.path, OptionFileKind::kConfiguration);
  if (!file.ok()) return file;
  absl::Status known = CheckNames(file->path, file->options, environment.configuration.known_options);
  for (const auto& [name, options] : file->profiles)
    known.Update(CheckNames(file->path, options, environment.configuration.known_options));
  if (!known.ok()) return known;
  return file;
}

const std::string& SummaryOf(const std::string& name) {
  const auto command = std::find_if(Commands().begin(), Commands().end(),
                                    [&](const Command& candidate) { return candidate.name == name; });
  LUMIFOLD_CHECK(command != Commands().end());
  return command->summary;
}

}  // namespace lumifold::client
