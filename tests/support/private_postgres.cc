#include "tests/support/private_postgres.h"

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>

#include "filter/image/check.h"

namespace lumifold {
namespace {

constexpr int kNotInstalled = 77;

}  // namespace

std::unique_ptr<PrivatePostgres> PrivatePostgres::Start(std::string* why_not) {
  std::array<int, 2> commands = {};
  std::array<int, 2> answers = {};
  LUMIFOLD_CHECK(pipe2(commands.data(), O_CLOEXEC) == 0 && pipe2(answers.data(), O_CLOEXEC) == 0);
  const pid_t script = fork();
  LUMIFOLD_CHECK(script >= 0);
  if (script == 0) {
    dup2(commands[0], STDIN_FILENO);
    dup2(answers[1], STDOUT_FILENO);
    execl(LUMIFOLD_PRIVATE_POSTGRES, LUMIFOLD_PRIVATE_POSTGRES, nullptr);
    _exit(1);
  }
  close(commands[0]);
  close(answers[1]);
  std::unique_ptr<PrivatePostgres> server(
      new PrivatePostgres(script, fdopen(commands[1], "w"), fdopen(answers[0], "r")));
  server->uri_ = server->ReadLine();
  if (!server->uri_.empty()) return server;
  int wait_status = 0;
  waitpid(script, &wait_status, 0);
  const bool is_missing = WIFEXITED(wait_status) && WEXITSTATUS(wait_status) == kNotInstalled;
  *why_not =
      is_missing ? "PostgreSQL is not installed (deploy/setup.sh --tests)" : "PostgreSQL does not start";
  return nullptr;
}

PrivatePostgres::PrivatePostgres(pid_t script, FILE* commands, FILE* answers)
    : script_(script), commands_(commands), answers_(answers) {}

PrivatePostgres::~PrivatePostgres() {
  fclose(commands_);  // the script ends with its input
  fclose(answers_);
  waitpid(script_, nullptr, 0);
}

std::string PrivatePostgres::ReadLine() {
  std::string line;
  for (int c = fgetc(answers_); c != EOF && c != '\n'; c = fgetc(answers_))
    line.push_back(static_cast<char>(c));
  return line;
}

void PrivatePostgres::Command(const char* line) {
  fputs(line, commands_);
  fflush(commands_);
  LUMIFOLD_CHECK(ReadLine() == "done");
}

}  // namespace lumifold
