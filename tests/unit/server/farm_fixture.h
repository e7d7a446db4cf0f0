#pragma once

#include <gtest/gtest.h>

#include <functional>
#include <memory>
#include <string>

#include "absl/time/time.h"
#include "lumifold/v1/farm.grpc.pb.h"
#include "server/server.h"
#include "tests/support/temp_folder.h"
#include "tests/unit/server/fake_worker.h"

namespace lumifold::server {

/// A coordinator on a free loopback port with a temporary data folder, and the calls of a client.
class FarmFixture : public ::testing::Test {
 protected:
  FarmFixture() { StartServer(); }

  ServerOptions Options() const;
  void StartServer();
  /// With a server that believes its one worker.
  void RestartForOneWorker();
  void StartServer(const ServerOptions& options);
  void StopServer() { server_.reset(); }

  /// Over the socket, or within the process if the server does not listen.
  std::shared_ptr<grpc::Channel> Channel() const;
  std::unique_ptr<FakeWorker> Worker(FakeWorkerOptions options = {}) const;

  /// A job of 20 x 12 pixels in tiles of 8, 10 samples in passes of 4: 6 tiles x (1 + 3) units; its scene is
  /// uploaded.
  v1::JobSpec Spec();
  static constexpr int kUnits = 24;
  static constexpr absl::Duration kPatience = absl::Minutes(10);

  grpc::Status Upload(const v1::AssetRef& asset, const std::string& content, size_t piece_bytes);
  absl::StatusOr<std::string> Submit(const v1::JobSpec& spec, const std::string& request_id = "request-1");
  absl::StatusOr<v1::JobStatus> Get(const std::string& job_id);
  /// The status once the job has ended.
  v1::JobStatus WaitForEnd(const std::string& job_id);
  /// The first status of WatchJob that meets the condition.
  v1::JobStatus WaitUntil(const std::string& job_id,
                          const std::function<bool(const v1::JobStatus&)>& condition);
  /// Until the condition is met; fails after kPatience.
  static void WaitFor(const std::function<bool()>& condition);
  absl::StatusOr<std::string> Download(const std::string& job_id, int32_t frame, uint64_t offset = 0);
  /// Submits Spec() and renders it with one worker: the reference result, equal byte for byte to all others.
  std::string RenderUndisturbed();

  TempFolder folder_;
  std::unique_ptr<Server> server_;
  /// Port of calls while server_ is stopped.
  int process_port_ = 0;
};

}  // namespace lumifold::server
