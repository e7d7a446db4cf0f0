#pragma once

#include <functional>
#include <ostream>
#include <string>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include "client/exit_code.h"
#include "client/film_filter.h"
#include "client/local_farm.h"
#include "proto/rpc/retry.h"

namespace lumifold::client {

/// All that a command touches besides its arguments and the files they name; tests put their own in.
struct Environment {
  /// Data, for other programs to read.
  std::ostream& out;
  /// Words, for people.
  std::ostream& err;
  /// Whether `err` is a terminal whose last line can be rewritten, and how wide it is.
  bool err_is_terminal = false;
  int terminal_columns = 80;
  /// HOST:PORT where --server is not given.
  std::string default_server = "127.0.0.1:7700";
  /// Threads a local farm renders with where --threads is not given.
  int default_threads = 1;
  /// Null in a build without coordinator and worker, which cannot `render`.
  LocalFarmFactory local_farm = nullptr;
  /// Null in a build without the filter, which cannot `filter`.
  FilmFilter film_filter = nullptr;
  /// Empty in a build without the filter.
  MethodTexts methods = {};
  /// True once the user has asked us to stop (Ctrl-C); asked several times a second.
  std::function<bool()> interrupted = [] { return false; };
  /// Clock, sleep and jitter.
  rpc::RetryEnvironment time = rpc::RetryEnvironment::Real();
};

/// Writes "lumifold: TEXT" as one line.
void ReportLine(const Environment& environment, absl::string_view text);

/// Writes "lumifold: MESSAGE" as one line and returns the code that belongs to the error.
ExitCode ReportError(const Environment& environment, const absl::Status& status);

}  // namespace lumifold::client
