#include "tests/unit/server/server_process.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cstdio>
#include <vector>

#include "absl/strings/numbers.h"
#include "filter/image/check.h"

namespace lumifold::server {

ServerProcess::ServerProcess(const std::string& data_dir, const std::string& log_path) {
  std::array<int, 2> ends = {-1, -1};
  LUMIFOLD_CHECK(pipe2(ends.data(), O_CLOEXEC) == 0);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, ends[1], STDOUT_FILENO);
  posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, log_path.c_str(), O_WRONLY | O_CREAT | O_APPEND,
                                   0644);
  std::vector<std::string> words = {LUMIFOLD_SERVER_PROGRAM, "--data", data_dir, "--listen", "127.0.0.1:0"};
  std::vector<char*> arguments;
  for (std::string& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  LUMIFOLD_CHECK(posix_spawn(&pid_, arguments[0], &actions, nullptr, arguments.data(), environ) == 0);
  posix_spawn_file_actions_destroy(&actions);
  close(ends[1]);
  std::FILE* output = fdopen(ends[0], "r");
  std::array<char, 256> line = {};
  if (std::fgets(line.data(), line.size(), output) != nullptr) {
    const std::string text = line.data();  // "listening on 127.0.0.1:PORT\n"
    LUMIFOLD_CHECK(absl::SimpleAtoi(text.substr(text.rfind(':') + 1), &port_));
  }
  std::fclose(output);
}

ServerProcess::~ServerProcess() {
  if (pid_ > 0) End(SIGKILL);
}

int ServerProcess::End(int signal) {
  int status = 0;
  kill(pid_, signal);
  waitpid(pid_, &status, 0);
  pid_ = -1;
  return WIFSIGNALED(status) ? -WTERMSIG(status) : WEXITSTATUS(status);
}

}  // namespace lumifold::server
