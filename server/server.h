#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "filter/image/file_system.h"
#include "proto/rpc/monotonic.h"
#include "server/access/access_control.h"
#include "server/limits.h"
#include "server/storage/retention.h"
#include "server/storage/storage_options.h"
#include "server/webhooks/webhooks.h"

namespace lumifold::device {
class DeviceProcess;
}  // namespace lumifold::device

namespace lumifold::filter {
class FilterDevice;
}  // namespace lumifold::filter

namespace spdlog {
class logger;
}  // namespace spdlog

namespace lumifold::server {

/// Where a coordinator keeps its jobs, how it writes there, and what it keeps.
struct DataOptions {
  /// The data folder; created if missing.
  std::string folder;
  /// Name of the ledger's store, see ledger::OpenJobStore; empty: SQLite in the data folder.
  std::string store;
  /// Writes all files but the ledger's; outlives the server.
  FileSystem* files = PrivateFileSystem();
  /// The number of open logs is set by the server.
  StorageOptions storage = {.reserve_bytes = uint64_t{16} << 20};
  /// What is kept of jobs that have ended; the free bytes are set by the disk.
  RetentionLimits retention;
};

struct PageOptions {
  /// HOST:PORT of the status page; port 0: a free port; empty: none.
  std::string address;
  /// PEM file with key and certificates of the page off loopback; empty: those of access control.
  std::string certificate;
};

struct SecurityOptions {
  /// Plain text off loopback is allowed. Without effect where the data folder has access control, see
  /// DataFolder.
  bool insecure = false;
  /// Lifetime of the certificates that access control signs.
  absl::Duration certificate_lifetime = access::kCredentialLifetime;
  /// Whom it may call when jobs have ended.
  webhooks::WebhookOptions webhooks;
};

/// For a coordinator that shares its store with others.
struct FarmOptions {
  /// HOST:PORT where clients, workers and other coordinators of the farm reach this one; empty: made from
  /// ServerOptions::listen and the name of this machine.
  std::string advertise;
  /// Time without a sign of life after which another coordinator takes the jobs of this one.
  absl::Duration failover = absl::Seconds(3);
  /// Called once, from any thread, when another coordinator has taken the jobs: this server is of no use any
  /// more; start another one.
  std::function<void()> on_expelled = [] {};
};

struct FilterOptions {
  /// At least 1; frames that are finished at a time share them.
  int threads = 1;
  /// Frames that are finished at a time; 0: as FinishOptions says.
  int processes = 1;
  /// Filters what is filtered in this process, or in child processes; null: the processor does.
  std::shared_ptr<filter::FilterDevice> device = nullptr;
  std::shared_ptr<device::DeviceProcess> device_process = nullptr;
  /// Filter in a child process of this program, whose main must call RunFinishFrameProcess.
  bool in_child_process = false;
  /// Limit of the child's address space in bytes; 0 for none.
  uint64_t memory_limit_bytes = 0;
  /// A child that runs longer is killed, and its job fails.
  absl::Duration time_limit = absl::Hours(24);
};

struct ServerOptions {
  DataOptions data;
  /// HOST:PORT to listen on; port 0 for a free port. Empty: do not listen (InProcessChannel still works).
  std::string listen;
  /// HOST:PORT at which metrics are shown, see monitoring::EndpointOptions; empty: nowhere.
  std::string metrics_address;
  PageOptions page;
  SecurityOptions security;
  FarmOptions farm;
  absl::Duration lease = absl::Seconds(30);
  absl::Duration heartbeat = absl::Seconds(5);
  /// The program has a worker of its own, and there will be no other.
  bool only_one_worker = false;
  FilterOptions filter;
  /// What callers may take.
  Limits limits;

  /// Monotonic clock: orders everything.
  std::function<absl::Time()> now = rpc::MonotonicNow;
  /// Wall clock: stamps submissions, for display and for the ids of jobs.
  std::function<absl::Time()> wall_now = [] { return absl::Now(); };
  /// Random numbers for job ids; default: those of the system.
  std::function<uint64_t()> random;
  /// Log of events; null for none.
  std::shared_ptr<spdlog::logger> log;
};

/// A coordinator with its gRPC server: locks the data folder, restores unfinished jobs, listens. With a store
/// that coordinators share it locks nothing: it joins those that use the store, and adopts the jobs of those
/// that are gone.
/// Threads: safe.
class Server {
 public:
  /// Errors: kFailedPrecondition where another coordinator uses the folder, the folder has jobs but no ledger
  /// (see recover.h), or the address is not allowed; kDataLoss for a malformed ledger; kInvalidArgument for a
  /// malformed address or a lease shorter than two heartbeats; kUnavailable naming the address or the file
  /// that cannot be used.
  static absl::StatusOr<std::unique_ptr<Server>> Start(ServerOptions options);

  /// Calls Shutdown.
  virtual ~Server() = default;

  /// The port it listens on; 0 if it does not listen.
  virtual int port() const = 0;

  /// A channel to this server within the process. Valid until the server is destroyed.
  virtual std::shared_ptr<grpc::Channel> InProcessChannel() = 0;

  /// Takes the way of a call through the coordinator, and blocks where that hangs: for watchdogs. Errors:
  /// those of the storage; the coordinator works all the same.
  virtual absl::Status Check() = 0;

  /// Ends all calls, commits the accepted units and stops. Returns within a second, unless a frame is being
  /// filtered in this process: then it waits for that frame. Later calls have no effect.
  virtual void Shutdown() = 0;
};

}  // namespace lumifold::server
