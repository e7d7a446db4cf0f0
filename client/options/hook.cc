#include "client/options/hook.h"

#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "client/reports/job_report.h"

namespace lumifold::client {
namespace {

constexpr char kPrefix[] = "LUMIFOLD_";

/// The environment of this process, with `variables` in place of its own of these names.
std::vector<std::string> EnvironmentWith(const std::vector<std::string>& variables) {
  std::vector<std::string> all = variables;
  for (char** entry = environ; *entry != nullptr; ++entry) {
    const std::string text = *entry;
    const std::string name = text.substr(0, text.find('=') + 1);
    bool is_new = true;
    for (const std::string& variable : variables) is_new = is_new && !absl::StartsWith(variable, name);
    if (is_new) all.push_back(text);
  }
  return all;
}

std::vector<char*> Pointers(std::vector<std::string>& texts) {
  std::vector<char*> pointers;
  pointers.reserve(texts.size() + 1);
  for (std::string& text : texts) pointers.push_back(text.data());
  pointers.push_back(nullptr);
  return pointers;
}

absl::Status Failed(const std::string& why) { return absl::InternalError(absl::StrCat("--hook: ", why)); }

}  // namespace

void Hook::AddTo(CommandLine& command_line) {
  command_line.AddText(
      "--hook", "COMMAND", &command,
      "Run this in a shell once the job has ended; $LUMIFOLD_JOB, _NAME, _STATE, _ERROR and _OUTPUT "
      "tell about it");
}

absl::Status Hook::Run(const v1::JobStatus& job, const std::string& output) const {
  if (command.empty()) return absl::OkStatus();
  const auto variable = [](const char* name, absl::string_view value) {
    return absl::StrCat(kPrefix, name, "=", value);
  };
  std::vector<std::string> variables = EnvironmentWith({
      variable("JOB", job.job_id()),
      variable("NAME", job.display_name()),
      variable("STATE", StateName(job.state())),
      variable("ERROR", job.error()),
      variable("OUTPUT", output),
  });
  std::vector<std::string> words = {"/bin/sh", "-c", command};
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_adddup2(&files, STDERR_FILENO, STDOUT_FILENO);
  pid_t child = 0;
  const int error =
      posix_spawn(&child, "/bin/sh", &files, nullptr, Pointers(words).data(), Pointers(variables).data());
  posix_spawn_file_actions_destroy(&files);
  if (error != 0) return Failed(absl::StrCat("cannot start: ", std::strerror(error)));
  int status = 0;
  while (waitpid(child, &status, 0) < 0) {
    if (errno != EINTR) return Failed(absl::StrCat("cannot wait for it: ", std::strerror(errno)));
  }
  if (WIFSIGNALED(status)) return Failed(absl::StrCat("ended by signal ", WTERMSIG(status)));
  if (WEXITSTATUS(status) != 0) return Failed(absl::StrCat("ended with code ", WEXITSTATUS(status)));
  return absl::OkStatus();
}

}  // namespace lumifold::client
