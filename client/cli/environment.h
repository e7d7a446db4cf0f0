#pragma once

#include <functional>
#include <istream>
#include <ostream>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include "client/cli/exit_code.h"
#include "client/cli/local_work.h"
#include "proto/rpc/retry.h"

namespace lumifold::client {

/// The coordinator where neither a server nor a profile is named.
inline constexpr char kDefaultServer[] = "127.0.0.1:7700";

struct CommandHelp;
struct OptionFile;

/// What the user looks at.
struct Terminal {
  /// Whether `err` is a terminal whose last line can be rewritten, and its width.
  bool err_is_terminal = false;
  int columns = 80;
  /// Whether `out` and `err` are terminals that show colours.
  bool out_has_colours = false;
  bool err_has_colours = false;
};

/// Values of options that are not given.
struct OptionDefaults {
  /// Of --server: HOST:PORT, or a list of them; empty: that of the default profile, else kDefaultServer.
  std::string server;
  /// Of --profile; empty: none.
  std::string profile;
  /// Of --user, whose jobs `submit` submits; empty: anonymous.
  std::string user;
  /// Of --threads, of a local farm.
  int threads = 1;
};

/// The user's file of options.
struct Configuration {
  /// Empty, or a file that is not there: there is none.
  std::string path;
  /// What is in it; null: there is none.
  const OptionFile* file = nullptr;
  /// Names of all options and arguments of all commands, as in files; empty: those of files are not checked.
  std::vector<std::string> known_options;
};

/// What of coordinator, worker and filter the build has within the program.
struct LocalParts {
  /// Null in a build without coordinator and worker; `render` then fails.
  LocalFarmFactory farm = nullptr;
  /// Null in a build without a worker; `plan` then fails.
  ScenePlanner scene_planner = nullptr;
  SceneReader scene_reader = nullptr;
  /// Null in a build without a worker; `submit` then leaves it to the farm.
  SceneCheck scene_check = nullptr;
  /// Null in a build without a worker; `filter` then reads .exr only.
  DisplayedReader displayed_reader = nullptr;
  /// Null in a build without the filter; `filter` then fails.
  FilmFilter film_filter = nullptr;
  /// Null in a build without the filter; `doctor` then says nothing of devices.
  DeviceLister devices = nullptr;
  /// Empty in a build without the filter.
  MethodTexts methods = {};
};

/// The outside world of a command, besides its arguments and the files they name. Tests replace it.
struct Environment {
  /// Output for programs.
  std::ostream& out;
  /// Messages for the user.
  std::ostream& err;
  Terminal terminal = {};
  OptionDefaults defaults = {};
  Configuration configuration = {};
  /// Folder of the user's profiles (identity::ProfilesFolder); empty: there are none.
  std::string profiles_folder = {};
  /// What the user types or pipes in, for secrets; null: nothing.
  std::istream* in = nullptr;
  /// Sent with every call of the command, see rpc::ContinueTrace; empty: none.
  std::string trace_parent = {};
  LocalParts local = {};
  /// True after the user interrupted the program (Ctrl-C); called several times a second.
  std::function<bool()> interrupted = [] { return false; };
  /// Where a command describes itself instead of running; null: it runs.
  CommandHelp* description = nullptr;
  /// Clock, sleep and jitter.
  rpc::RetryEnvironment time = rpc::RetryEnvironment::Real();
};

/// Prints "lumifold: TEXT" as one line to `err`.
void ReportLine(const Environment& environment, absl::string_view text);

/// Prints "lumifold: MESSAGE" as one line to `err` and returns the exit code of the error.
ExitCode ReportError(const Environment& environment, const absl::Status& status);

}  // namespace lumifold::client
