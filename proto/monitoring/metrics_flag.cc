#include "proto/monitoring/metrics_flag.h"

#include <CLI/CLI.hpp>
#include <string>

namespace lumifold::monitoring {

void AddMetricsFlag(CLI::App* app, std::string* address) {
  app->add_option(
         "--metrics-address", *address,
         "Show metrics for Prometheus at http://HOST:PORT/metrics, to anyone who reaches it; PORT alone: "
         "on loopback (default: off)")
      ->type_name("HOST:PORT");
}

}  // namespace lumifold::monitoring
