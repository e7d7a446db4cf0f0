#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <iostream>
#include <string>
#include <thread>

#include "client/cli/colour.h"
#include "client/cli/interrupt.h"
#include "client/cli/option_file.h"
#include "client/commands/run_client.h"
#include "client/local/displayed_picture.h"
#include "client/local/film_filter.h"
#include "client/local/in_process_farm.h"
#include "client/local/scene_facts.h"
#include "client/local/scene_planner.h"
#include "proto/device/serve_device.h"
#include "proto/identity/profile.h"
#include "proto/rpc/trace_context.h"
#include "proto/threads/end_process.h"

namespace {

constexpr int kDefaultColumns = 80;

/// Between two calls no thread of ours waits for the network, and gRPC looks at a connection that is being
/// made at this interval only. Its default of 5000 ms delays a client's return after an outage by as much
/// again as the pauses do.
constexpr const char* kConnectionPollMs = "200";

int TerminalColumns() {
  winsize size = {};
  const bool known = ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0;
  return known ? size.ws_col : kDefaultColumns;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && std::string(argv[1]) == lumifold::device::kDeviceCommand)
    return lumifold::device::RunDeviceProcess({argv + 2, argv + argc});
  namespace client = lumifold::client;
  client::CatchInterrupts();
  setenv("GRPC_CLIENT_CHANNEL_BACKUP_POLL_INTERVAL_MS", kConnectionPollMs, /*overwrite=*/0);
  client::Environment environment{.out = std::cout, .err = std::cerr};
  environment.in = &std::cin;
  environment.profiles_folder = lumifold::identity::ProfilesFolder();
  environment.terminal.err_is_terminal = isatty(STDERR_FILENO) == 1;
  environment.terminal.columns = TerminalColumns();
  const auto has_colours = [](int file) {
    return client::WantsColour(isatty(file) == 1, std::getenv("NO_COLOR"), std::getenv("TERM"));
  };
  environment.terminal.out_has_colours = has_colours(STDOUT_FILENO);
  environment.terminal.err_has_colours = has_colours(STDERR_FILENO);
  environment.configuration.path = client::ConfigurationPath(environment.profiles_folder);
  if (const char* path = std::getenv("LUMIFOLD_CONFIG")) environment.configuration.path = path;
  if (const char* profile = std::getenv("LUMIFOLD_PROFILE")) environment.defaults.profile = profile;
  if (const char* server = std::getenv("LUMIFOLD_SERVER")) environment.defaults.server = server;
  if (const char* user = std::getenv("USER")) environment.defaults.user = user;
  environment.defaults.threads = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  const char* const trace_parent = std::getenv("TRACEPARENT");
  environment.trace_parent =
      lumifold::rpc::ContinueTrace(trace_parent == nullptr ? "" : trace_parent, lumifold::rpc::SystemRandom);
  environment.interrupted = client::Interrupted;
  environment.local.farm = lumifold::local::StartLocalFarm;
  environment.local.scene_planner = lumifold::local::PlanScene;
  environment.local.scene_check = lumifold::local::CheckScene;
  environment.local.scene_reader = lumifold::local::ReadSceneFacts;
  environment.local.displayed_reader = lumifold::local::ReadDisplayed;
  environment.local.film_filter = lumifold::local::FilterFilm;
  environment.local.devices = lumifold::local::ListDevices;
  environment.local.methods = lumifold::local::DescribeMethods();
  lumifold::threads::EndProcess(client::RunClient(argc, argv, environment));
}
