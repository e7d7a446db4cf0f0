#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"

namespace prometheus {
class Collectable;
}  // namespace prometheus

namespace lumifold::monitoring {

struct EndpointOptions {
  /// HOST:PORT; PORT or :PORT alone means 127.0.0.1. Port 0: a free port.
  std::string address;
  /// What is shown, in this order. A prometheus::Registry is one, for parts of the coordinator that count by themselves;
  /// so is FarmMetrics, which asks when it is asked.
  std::vector<std::shared_ptr<prometheus::Collectable>> sources;
  /// The sources are asked once in this time at most; in between, answers repeat the last figures.
  absl::Duration freshness = absl::Seconds(1);
  /// From its first moment to its last; a connection that takes longer is closed.
  absl::Duration connection_time = absl::Seconds(5);
  /// At a time; further ones wait in the kernel.
  size_t connections = 32;
  std::function<absl::Time()> now;
};

/// Shows metrics at http://ADDRESS/metrics in Prometheus' text format, in plain text and to anyone who reaches the
/// address. Whatever callers send, memory and time are bounded, see EndpointOptions and kMaxRequestBytes.
///
/// Of prometheus-cpp only the library of metrics is used. Its HTTP server, civetweb, waits for the bodies of requests
/// without a limit of time, so that as many slow callers as it has threads shut it; and it can do much that a
/// coordinator should not, such as CGI.
/// Threads: safe; it has one of its own.
class Endpoint {
 public:
  /// Errors: kInvalidArgument for a malformed address; kUnavailable if it cannot listen there.
  static absl::StatusOr<std::unique_ptr<Endpoint>> Start(EndpointOptions options);
  virtual ~Endpoint() = default;
  /// HOST:PORT with the port that it has.
  virtual const std::string& address() const = 0;
};

}  // namespace lumifold::monitoring
