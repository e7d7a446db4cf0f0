#pragma once

#include <sys/types.h>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "lumifold/v1/farm.grpc.pb.h"
#include "proto/rpc/credentials.h"

namespace lumifold::bench {

/// A coordinator in a process of its own, which ends with this object.
/// Threads: one at a time.
class ServerProcess {
 public:
  /// Starts `program` on a free port of this machine and waits until it listens. Its log goes to `log_path`.
  /// `options` are added to its command line.
  /// Errors: kUnavailable where it does not listen.
  static absl::StatusOr<std::unique_ptr<ServerProcess>> Start(const std::string& program,
                                                              const std::string& data,
                                                              const std::string& log_path,
                                                              const std::vector<std::string>& options = {});
  /// SIGTERM.
  ~ServerProcess();
  ServerProcess(const ServerProcess&) = delete;
  ServerProcess& operator=(const ServerProcess&) = delete;

  /// SIGKILL.
  void Kill() { End(9); }
  const std::string& address() const { return address_; }
  /// Sends a signal to its child processes. Returns how many there are.
  int SignalChildren(int signal) const;
  /// Processor time so far, without that of its children.
  double cpu_seconds() const;
  /// Resident memory now.
  int64_t rss_bytes() const;

 private:
  explicit ServerProcess(pid_t pid) : pid_(pid) {}
  void End(int signal);

  pid_t pid_;
  std::string address_;
};

/// Calls of a client.
/// Threads: safe.
class Client {
 public:
  Client(const std::string& address, const rpc::Security& security);

  /// Stores a scene that no worker reads.
  absl::StatusOr<v1::SceneRef> UploadScene();
  /// Returns the id of the job.
  absl::StatusOr<std::string> Submit(const v1::JobSpec& spec, const std::string& request_id);
  absl::Status Cancel(const std::string& job_id);
  absl::StatusOr<v1::JobStatus> Status(const std::string& job_id);
  absl::StatusOr<v1::ListJobsResponse> List(int limit, const std::string& page_token);

 private:
  std::unique_ptr<v1::FarmService::Stub> stub_;
};

}  // namespace lumifold::bench
