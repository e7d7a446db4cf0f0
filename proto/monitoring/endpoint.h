#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "proto/http/server.h"
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

/// Listens at HOST:PORT; PORT or :PORT alone means 127.0.0.1. Port 0: a free port. Needs no thread: a worker
/// does it before it enters its sandbox, inside which nothing may listen any more.
/// Errors: kInvalidArgument for a malformed address; kUnavailable if it cannot listen there.
absl::StatusOr<EndpointSockets> ListenForMetrics(const std::string& address);

struct EndpointOptions {
  /// Must outlive the endpoint. Its connections wait while there is no endpoint.
  const EndpointSockets* sockets = nullptr;
  /// What is shown, in this order. A prometheus::Registry is one, for parts of a program that count by
  /// themselves; what MakeSource returns asks when it is asked.
  std::vector<std::shared_ptr<prometheus::Collectable>> sources;
  /// The sources are asked once in this time at most; in between, answers repeat the last figures.
  absl::Duration freshness = absl::Seconds(1);
  /// The sources are asked by one thread.
  http::Limits limits = {.connections = 32, .threads = 1};
  std::function<absl::Time()> now;
};

/// Shows metrics at http://ADDRESS/metrics in Prometheus' text format, in plain text and to anyone who
/// reaches the address. Of prometheus-cpp only the library of metrics is used, not its HTTP server.
/// Threads: safe; it has its own.
class Endpoint {
 public:
  /// Errors: those of http::Server::Start.
  static absl::StatusOr<std::unique_ptr<Endpoint>> Start(EndpointOptions options);
  virtual ~Endpoint() = default;
};

}  // namespace lumifold::monitoring
