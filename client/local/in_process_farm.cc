#include "client/local/in_process_farm.h"

#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "filter/opencl/open_device.h"
#include "proto/device/device_process.h"
#include "proto/threads/event.h"
#include "server/server.h"
#include "worker/connection/connection.h"

namespace lumifold::local {
namespace {

/// A new temporary folder; removed with its contents.
class TemporaryFolder {
 public:
  static absl::StatusOr<std::unique_ptr<TemporaryFolder>> Make() {
    std::error_code error;
    const std::filesystem::path base = std::filesystem::temp_directory_path(error);
    std::string path = (error ? std::string("/tmp") : base.string()) + "/lumifold-XXXXXX";
    if (mkdtemp(path.data()) == nullptr) {
      return absl::UnavailableError(
          absl::StrCat("cannot create a temporary folder ", path, ": ", std::strerror(errno)));
    }
    return std::unique_ptr<TemporaryFolder>(new TemporaryFolder(path));
  }

  ~TemporaryFolder() {
    std::error_code ignored;  // the system clears its temporary folder
    std::filesystem::remove_all(path_, ignored);
  }

  const std::string& path() const { return path_; }

 private:
  explicit TemporaryFolder(std::string path) : path_(std::move(path)) {}

  std::string path_;
};

/// Lines from any thread.
class Lines {
 public:
  void Add(const std::string& line) {
    const std::lock_guard lock(mutex_);
    lines_.push_back(line);
  }
  std::vector<std::string> All() const {
    const std::lock_guard lock(mutex_);
    return lines_;
  }

 private:
  mutable std::mutex mutex_;
  std::vector<std::string> lines_;
};

class InProcessFarm final : public client::LocalFarm {
 public:
  InProcessFarm(std::unique_ptr<TemporaryFolder> folder, std::unique_ptr<server::Server> server, int threads,
                std::shared_ptr<Lines> warnings)
      : folder_(std::move(folder)),
        warnings_(std::move(warnings)),
        server_(std::move(server)),
        channel_(server_->InProcessChannel()) {
    worker_ = std::thread([channel = channel_, threads, this] {
      worker::WorkerOptions worker_options;
      worker_options.name = "local";
      worker_options.threads = threads;
      // Its own coordinator never refuses it, and errors of units fail the job.
      worker::RunWorker(
          {.addresses = {"in-process"}, .connect = [channel](const std::string&) { return channel; }},
          worker_options, stop_)
          .IgnoreError();
    });
  }

  ~InProcessFarm() override {
    stop_.Notify();
    worker_.join();
    channel_ = nullptr;
    server_->Shutdown();
  }

  std::shared_ptr<grpc::Channel> channel() override { return channel_; }
  std::vector<std::string> Warnings() override { return warnings_->All(); }

 private:
  std::unique_ptr<TemporaryFolder> folder_;  // null if the user named a folder
  const std::shared_ptr<Lines> warnings_;
  std::unique_ptr<server::Server> server_;
  std::shared_ptr<grpc::Channel> channel_;
  threads::Event stop_;
  std::thread worker_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<client::LocalFarm>> StartLocalFarm(const client::LocalFarmOptions& options) {
  std::unique_ptr<TemporaryFolder> folder;
  server::ServerOptions server_options;
  server_options.data.folder = options.state_dir;
  server_options.only_one_worker = true;
  server_options.filter.threads = options.threads;
  const auto warnings = std::make_shared<Lines>();
  absl::StatusOr<filter::OpenedDevice> device =
      device::OpenDevice({.choice = {options.device, options.allows_other_bits},
                          .warn = [warnings](const std::string& line) { warnings->Add(line); }});
  if (!device.ok()) return device.status();
  server_options.filter.device = device->device;
  if (options.state_dir.empty()) {
    absl::StatusOr<std::unique_ptr<TemporaryFolder>> made = TemporaryFolder::Make();
    if (!made.ok()) return made.status();
    folder = *std::move(made);
    server_options.data.folder = folder->path();
  }
  absl::StatusOr<std::unique_ptr<server::Server>> server = server::Server::Start(std::move(server_options));
  if (!server.ok()) return server.status();
  return std::make_unique<InProcessFarm>(std::move(folder), *std::move(server), options.threads, warnings);
}

}  // namespace lumifold::local
