#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "proto/rpc/byte_stream.h"

namespace prometheus {
class Collectable;
}  // namespace prometheus

namespace lumifold::monitoring {

/// Sockets that listen for an endpoint.
struct EndpointSockets {
  std::string address;  // HOST:PORT with the port that it has
  std::vector<rpc::FileHandle> listening;
};

/// Listens at HOST:PORT; PORT or :PORT alone means 127.0.0.1. Port 0: a free port. Needs no thread: a worker does it
/// before it enters its fence, inside which nothing may listen any more.
/// Errors: kInvalidArgument for a malformed address; kUnavailable if it cannot listen there.
absl::StatusOr<EndpointSockets> ListenForMetrics(const std::string& address);

struct EndpointOptions {
  /// Must outlive the endpoint. Its connections wait while there is no endpoint.
  const EndpointSockets* sockets = nullptr;
  /// What is shown, in this order. A prometheus::Registry is one, for parts of a program that count by themselves; what
  /// MakeSource returns asks when it is asked.
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
/// without a limit of time, so that as many slow callers as it has threads shut it; and it can do much that our
/// programs should not, such as CGI.
/// Threads: safe; it has one of its own.
class Endpoint {
 public:
  /// Errors: kUnavailable if no descriptor is left.
  static absl::StatusOr<std::unique_ptr<Endpoint>> Start(EndpointOptions options);
  virtual ~Endpoint() = default;
};

}  // namespace lumifold::monitoring
