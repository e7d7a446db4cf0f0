#include "client/commands/commands.h"

#include <algorithm>

#include "client/cli/command_line.h"
#include "filter/image/check.h"

namespace lumifold::client {

namespace {

std::vector<Command> CommandsOfJobs() {
  return {
      {{"render", "Render a scene on this machine and write the picture",
        "render scene.glb --size 1920x1080 --spp 256 -o picture.exr"},
       RunRender},
      {{"plan", "Print what a scene needs modelled, and why", "plan scene.glb"}, RunPlan},
      {{"submit", "Submit a scene to a coordinator and print the job's id",
        "submit scene.glb --spp 256 --name \"shot 7\" --download shot7.exr"},
       RunSubmit},
      {{"status", "Print the status of a job", "status last"}, RunStatus},
      {{"wait", "Wait until a job has ended, without showing progress", "wait last && echo done"}, RunWait},
      {{"watch", "Show a job's progress until it has ended", "watch \"shot 7\" --preview now.png"}, RunWatch},
      {{"page", "Print a link to the coordinator's status page", "page last --share --hours 24"}, RunPage},
      {{"list", "List the coordinator's jobs, newest first", "list --state running,failed --user ann"},
       RunList},
      {{"explain", "Say why a job does not run, or runs slowly", "explain last"}, RunExplain},
      {{"logs", "Print the last events of a job or a worker", "logs last --limit 20"}, RunLogs},
      {{"pause", "Render no more units of a job until it is resumed", "pause \"shot 7\""}, RunPause},
      {{"resume", "Let a paused job go on", "resume \"shot 7\""}, RunResume},
      {{"move-to-front", "Render a job before its user's others", "move-to-front \"shot 7\""},
       RunMoveToFront},
      {{"set-priority", "Change the priority of a job", "set-priority \"shot 7\" 20"}, RunSetPriority},
      {{"add-samples", "Give a job more samples per pixel", "add-samples \"shot 7\" 1024"}, RunAddSamples},
      {{"retry", "Render parts of a job again, or go on with a failed one",
        "retry \"shot 7\" --frames 17,20-22"},
       RunRetry},
      {{"cancel", "Stop a job", "cancel \"shot 7\""}, RunCancel},
      {{"delete", "Delete a job that has ended, and its pictures", "delete \"shot 7\""}, RunDelete},
      {{"download", "Download a finished frame of a job", "download last --frames 1-48 -o out.####.exr"},
       RunDownload},
  };
}

std::vector<Command> CommandsOfFarms() {
  return {
      {{"workers", "List the workers", "workers node-3"}, RunWorkers},
      {{"drain", "Let a worker finish its units and leave", "drain node-3 --after-units"}, RunDrain},
      {{"block", "Give a worker no units until it is readmitted", "block node-3 --reason \"bad memory\""},
       RunBlock},
      {{"readmit", "Give a worker units again", "readmit node-3"}, RunReadmit},
      {{"usage", "Print the core hours of users and jobs", "usage --since 2026-11-01"}, RunUsage},
      {{"server-status", "Print the state of the coordinator", "server-status --json"}, RunServerStatus},
      {{"login", "Get access to a coordinator with a code", "login render-1:7700 CODE"}, RunLogin},
      {{"logout", "Forget the access to a coordinator", "logout"}, RunLogout},
      {{"whoami", "Print as whom the coordinator knows you", "whoami"}, RunWhoAmI},
      {{"invite", "Make a code for another person or a worker", "invite ann --scope read,submit"}, RunInvite},
      {{"identities", "List who has access: tokens, certificates, invites", "identities --all"},
       RunIdentities},
      {{"revoke", "Take the access of a person or a worker away", "revoke ann"}, RunRevoke},
  };
}

std::vector<Command> CommandsOfFiles() {
  return {
      {{"filter", "Filter the noise of a picture that is already rendered", "filter noisy.exr -o clean.exr"},
       RunFilter},
      {{"convert", "Write a layer of a picture as .png",
        "convert picture.exr -o picture.png --view filmic --exposure auto"},
       RunConvert},
      {{"compare", "Print the error of one picture against another",
        "compare picture.exr reference.exr --metric flip,psnr"},
       RunCompare},
      {{"info", "Print what is in a scene or a picture", "info scene.glb"}, RunInfo},
      {{"doctor", "Say what is wrong with this installation and its farm", "doctor --server render-1:7700"},
       RunDoctor,
       /*is_without_configuration=*/true},
      {{"schema", "Print the JSON Schema of job files", "schema > job.schema.json"},
       RunSchema,
       /*is_without_configuration=*/true},
      {{"completion", "Print a script that completes this command line in a shell",
        "completion bash > ~/.lumifold-completion"},
       RunCompletion,
       /*is_without_configuration=*/true},
      {{"man", "Print the manual page of a command", "man render | man -l -"},
       RunMan,
       /*is_without_configuration=*/true},
  };
}

}  // namespace

const std::vector<Command>& Commands() {
  static const auto* const commands = [] {
    auto* const all = new std::vector<Command>;
    for (const std::vector<Command>& some : {CommandsOfJobs(), CommandsOfFarms(), CommandsOfFiles()})
      all->insert(all->end(), some.begin(), some.end());
    return all;
  }();
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

const CommandWords& WordsOf(const std::string& name) {
  const auto command = std::find_if(Commands().begin(), Commands().end(),
                                    [&](const Command& candidate) { return candidate.name == name; });
  LUMIFOLD_CHECK(command != Commands().end());
  return *command;
}

}  // namespace lumifold::client
