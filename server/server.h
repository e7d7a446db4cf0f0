#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "proto/rpc/credentials.h"

namespace spdlog {
class logger;
}  // namespace spdlog

namespace lumifold::server {

struct ServerOptions {
  /// The data folder; made where it is missing.
  std::string data_dir;
  /// HOST:PORT to listen on, port 0 for any free one; empty for none at all (InProcessChannel still works).
  std::string listen;
  rpc::Security security;

  absl::Duration lease = absl::Seconds(30);
  absl::Duration heartbeat = absl::Seconds(5);

  /// Threads a frame is filtered with, at least 1.
  int filter_threads = 1;
  /// Filter in a child process, started from this very program, whose main must know RunFinishFrameProcess.
  bool filter_in_child_process = false;
  /// Address space of that child; 0 for no limit.
  uint64_t filter_memory_limit_bytes = 0;

  std::function<absl::Time()> now = [] { return absl::Now(); };
  /// For job ids; the default is the system's source of random numbers.
  std::function<uint64_t()> random;
  /// Where events are told; null for nowhere.
  std::shared_ptr<spdlog::logger> log;
};

/// A coordinator that can be reached: claims the data folder, goes on with unfinished jobs, listens.
/// Threads: safe.
class Server {
 public:
  /// Errors: kFailedPrecondition where the folder is another coordinator's, or listening there is not
  /// allowed; kInvalidArgument for a bad address or a lease shorter than two heartbeats; kUnavailable naming
  /// the address where it cannot be listened on, or naming the file that cannot be used.
  static absl::StatusOr<std::unique_ptr<Server>> Start(ServerOptions options);

  /// As Shutdown.
  virtual ~Server() = default;

  /// The port it listens on; 0 without one.
  virtual int port() const = 0;

  /// A channel to it that touches no network. Valid as long as the server lives.
  virtual std::shared_ptr<grpc::Channel> InProcessChannel() = 0;

  /// Ends all calls, stores what was accepted, stops. Returns within a second, save for a frame filtered in
  /// this process, which it waits for. More calls do nothing.
  virtual void Shutdown() = 0;
};

}  // namespace lumifold::server
