#include "proto/logging/last_words.h"

#include <signal.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <exception>
#include <string_view>

namespace lumifold::logging {
namespace {

constexpr int kExitFailure = 1;

/// Made before memory is short. What follows may run in a signal handler, and allocates nothing.
char lead[256] = "";

[[noreturn]] void End(std::string_view cause) {
  for (const std::string_view part :
       {std::string_view(lead), cause,
        std::string_view("; it has probably run out of memory or threads (ulimit -v, ulimit -u, "
                         "--memory-mb, the control group)\n")}) {
    if (write(STDERR_FILENO, part.data(), part.size()) < 0)
      break;  // nobody reads: nothing is left to be done
  }
  _exit(kExitFailure);
}

[[noreturn]] void OnTerminate() {
  try {
    if (const std::exception_ptr error = std::current_exception()) std::rethrow_exception(error);
  } catch (const std::exception& error) {
    End(error.what());
  } catch (...) {
  }
  End("ended by an error that nobody handles");
}

void OnAbort(int /*signal*/) { End("ended by a library that could not go on"); }

}  // namespace

void SayLastWords(const std::string& program) {
  const std::string text = program + ": ";
  std::strncpy(lead, text.c_str(), sizeof(lead) - 1);
  std::set_terminate(OnTerminate);
  struct sigaction action = {};
  action.sa_handler = OnAbort;
  sigaction(SIGABRT, &action, nullptr);
}

}  // namespace lumifold::logging
