#include "server/server.h"

#include <grpcpp/impl/codegen/service_type.h>
#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>
#include <spdlog/sinks/null_sink.h>
#include <spdlog/spdlog.h>

#include <random>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/rpc/limits.h"
#include "server/coordinator_impl.h"
#include "server/grpc_adapter.h"
#include "server/ledger/sqlite_job_store.h"

namespace lumifold::server {
namespace {

/// Time for running calls to end at shutdown. Streams of workers never end by themselves, so shutdown always
/// takes this long.
constexpr absl::Duration kGrace = absl::Milliseconds(100);
/// Workers and clients ping every 20 s; connections that ping faster than this are closed.
constexpr int kMinPingIntervalMs = 10'000;
constexpr int kKeepAliveMs = 20'000;
constexpr int kKeepAliveTimeoutMs = 10'000;

class ServerImpl final : public Server {
 public:
  explicit ServerImpl(ServerOptions options) : options_(std::move(options)), folder_(options_.data_dir) {}
  ~ServerImpl() override { Shutdown(); }

  absl::Status Open();
  int port() const override { return port_; }
  std::shared_ptr<grpc::Channel> InProcessChannel() override;
  void Shutdown() override;

 private:
  absl::Status Listen();

  // In order of construction: each uses members above it.
  const ServerOptions options_;
  const DataFolder folder_;
  rpc::FileHandle lock_;
  std::unique_ptr<ledger::JobStore> store_;
  std::unique_ptr<AssetStore> assets_;
  std::unique_ptr<FrameFinisher> finisher_;
  std::unique_ptr<Coordinator> coordinator_;
  std::vector<std::unique_ptr<grpc::Service>> services_;
  std::unique_ptr<grpc::Server> grpc_server_;
  int port_ = 0;
};

absl::Status ServerImpl::Open() {
  if (options_.lease < 2 * options_.heartbeat) {
    return absl::InvalidArgumentError(absl::StrCat("a lease of ", absl::FormatDuration(options_.lease),
                                                   " is shorter than two heartbeats of ",
                                                   absl::FormatDuration(options_.heartbeat)));
  }
  if (!options_.listen.empty()) {
    if (absl::Status status = rpc::CheckListenAddress(options_.listen, options_.security); !status.ok())
      return status;
  }
  absl::StatusOr<rpc::FileHandle> lock = folder_.Claim();
  if (!lock.ok()) return lock.status();
  lock_ = *std::move(lock);
  if (absl::Status status = folder_.RemoveLeftovers(); !status.ok()) return status;
  absl::StatusOr<std::unique_ptr<ledger::JobStore>> store = ledger::OpenSqliteJobStore(folder_.LedgerPath());
  if (!store.ok()) return store.status();
  store_ = *std::move(store);
  assets_ = std::make_unique<AssetStore>(folder_.AssetsPath(), folder_.IncomingPath(), options_.log);
  finisher_ =
      options_.filter_in_child_process
          ? MakeChildProcessFinisher(folder_, {.threads = options_.filter_threads,
                                               .memory_limit_bytes = options_.filter_memory_limit_bytes,
                                               .time_limit = options_.filter_time_limit})
          : MakeInProcessFinisher(folder_, store_.get(), options_.filter_threads, options_.now);
  absl::StatusOr<std::unique_ptr<Coordinator>> coordinator =
      Coordinator::Create({.lease = options_.lease,
                           .heartbeat = options_.heartbeat,
                           .now = options_.now,
                           .random = options_.random,
                           .log = options_.log},
                          folder_, store_.get(), assets_.get(), finisher_.get());
  if (!coordinator.ok()) return coordinator.status();
  coordinator_ = *std::move(coordinator);
  return Listen();
}

absl::Status ServerImpl::Listen() {
  services_ = MakeServices(coordinator_.get());
  grpc::ServerBuilder builder;
  builder.SetMaxReceiveMessageSize(rpc::kMaxMessageBytes);
  builder.SetMaxSendMessageSize(rpc::kMaxMessageBytes);
  // Otherwise two coordinators could listen on the same port and share its calls.
  builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, kKeepAliveMs);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, kKeepAliveTimeoutMs);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS, kMinPingIntervalMs);
  if (!options_.listen.empty()) {
    builder.AddListeningPort(options_.listen, rpc::MakeServerCredentials(options_.security), &port_);
  }
  for (const std::unique_ptr<grpc::Service>& service : services_) builder.RegisterService(service.get());
  grpc_server_ = builder.BuildAndStart();
  if (grpc_server_ == nullptr || (!options_.listen.empty() && port_ == 0)) {
    return absl::UnavailableError(absl::StrCat("cannot listen on ", options_.listen,
                                               ": the port is taken, or the host is not this machine"));
  }
  if (!options_.listen.empty()) {
    options_.log->info("event=listening address={} port={} data=\"{}\"", options_.listen, port_,
                       options_.data_dir);
  }
  return absl::OkStatus();
}

std::shared_ptr<grpc::Channel> ServerImpl::InProcessChannel() {
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(rpc::kMaxMessageBytes);
  arguments.SetMaxSendMessageSize(rpc::kMaxMessageBytes);
  return grpc_server_->InProcessChannel(arguments);
}

void ServerImpl::Shutdown() {
  if (coordinator_ != nullptr) coordinator_->StopLeasing();
  if (grpc_server_ != nullptr) grpc_server_->Shutdown(absl::ToChronoTime(absl::Now() + kGrace));
  if (coordinator_ != nullptr) coordinator_->Shutdown();
}

}  // namespace

absl::StatusOr<std::unique_ptr<Server>> Server::Start(ServerOptions options) {
  if (options.log == nullptr) {
    options.log = std::make_shared<spdlog::logger>("", std::make_shared<spdlog::sinks::null_sink_mt>());
  }
  if (options.random == nullptr) {
    options.random = [] {
      std::random_device source;
      return (uint64_t{source()} << 32) | source();
    };
  }
  auto server = std::make_unique<ServerImpl>(std::move(options));
  if (absl::Status status = server->Open(); !status.ok()) return status;
  return server;
}

}  // namespace lumifold::server
