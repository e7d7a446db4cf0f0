#include "server/server.h"

#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/health_check_service_interface.h>
#include <grpcpp/impl/codegen/service_type.h>
#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>
#include <grpcpp/support/byte_buffer.h>
#include <spdlog/sinks/null_sink.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <array>
#include <random>
#include <set>
#include <thread>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "filter/manifold/filter_device.h"
#include "lumifold/v1/farm.pb.h"
#include "proto/device/device_process.h"
#include "proto/identity/secrets.h"
#include "proto/logging/fields.h"
#include "proto/logging/job_labels.h"
#include "proto/monitoring/endpoint.h"
#include "proto/monitoring/process.h"
#include "proto/rpc/limits.h"
#include "proto/rpc/monotonic.h"
#include "proto/threads/event.h"
#include "server/access/access_control.h"
#include "server/access/audit_log.h"
#include "server/access/authorisation.h"
#include "server/access/caller_check.h"
#include "server/access/certificate_authority.h"
#include "server/access/identity.h"
#include "server/access/open_calls.h"
#include "server/assets/asset_checks.h"
#include "server/cluster/farm_peers.h"
#include "server/cluster/membership.h"
#include "server/commit/recover.h"
#include "server/coordinator/coordinator.h"
#include "server/coordinator/event_log.h"
#include "server/coordinator/frame_limit.h"
#include "server/finish/frame_finisher.h"
#include "server/ledger/open_job_store.h"
#include "server/ledger/roster.h"
#include "server/metrics/farm_metrics.h"
#include "server/net/connection_limits.h"
#include "server/net/listener.h"
#include "server/page/status_page.h"
#include "server/picture/make_picture.h"
#include "server/preview/make_preview.h"
#include "server/preview/preview_maker.h"
#include "server/services/access_service.h"
#include "server/services/call_gate.h"
#include "server/services/farm_service.h"
#include "server/services/service_health.h"
#include "server/services/worker_service.h"
#include "server/storage/folder_contents.h"
#include "server/storage/reserve_file.h"

namespace lumifold::server {
namespace {

/// Time for running calls to end at shutdown. Streams of workers never end by themselves, so shutdown always
/// takes this long.
constexpr absl::Duration kGrace = absl::Milliseconds(100);
/// Time between two looks for streams that have stalled.
constexpr absl::Duration kStallInterval = absl::Seconds(1);
constexpr size_t kPageKeyBytes = 32;

ServerOptions WithEvents(ServerOptions options, const std::shared_ptr<logging::JobLabels>& labels,
                         EventLog* events) {
  options.log = MakeEventLogger(options.log, labels, events);
  return options;
}

/// In lower case, as browsers send it; empty for a malformed address.
std::string HostOf(const std::string& address) {
  rpc::HostAndPort where;
  (void)rpc::ParseHostAndPort(address, &where);
  return absl::AsciiStrToLower(where.host);
}

class ServerImpl final : public Server {
 public:
  explicit ServerImpl(ServerOptions options)
      : options_(WithEvents(std::move(options), log_.labels, &log_.events)),
        folder_(options_.data.folder, options_.data.files),
        previews_(ChildOptions()) {}
  ~ServerImpl() override { Shutdown(); }

  absl::Status Open();
  int port() const override { return calls_.port; }
  std::shared_ptr<grpc::Channel> InProcessChannel() override;
  absl::Status Check() override { return coordinator_->jobs().GetServerStatus().status(); }
  void Shutdown() override;

 private:
  /// What lines of the log say of jobs, and where they are kept for GetLog.
  struct OwnLog {
    EventLog events;
    const std::shared_ptr<logging::JobLabels> labels = std::make_shared<logging::JobLabels>();
  };
  /// Who may call.
  struct Access {
    rpc::Security security;
    const std::unique_ptr<access::Authoriser> authoriser = access::MakeAuthoriser();
    std::unique_ptr<access::AccessControl> control;  // null: plain text
    std::unique_ptr<access::Callers> callers = access::MakeLocalCallers();
    access::OpenCalls local_calls;
    std::unique_ptr<access::AuditLog> audit;
  };
  struct Assets {
    std::unique_ptr<AssetStore> store;
    std::unique_ptr<AssetChecks> checks;
  };
  struct Previews {
    explicit Previews(const ChildProcessOptions& options) : process(options) {}

    ChildProcess process;
    std::unique_ptr<PreviewMaker> maker;
  };
  /// One of several coordinators of a farm.
  struct Member {
    std::unique_ptr<ledger::Roster> roster;
    std::unique_ptr<cluster::Membership> membership;
    cluster::FarmPeers peers;
    bool has_left = false;
  };
  /// What takes calls.
  struct Calls {
    std::unique_ptr<CallGate> gate;
    std::vector<std::unique_ptr<grpc::Service>> services;
    std::unique_ptr<grpc::experimental::ExternalConnectionAcceptor> acceptor;
    std::unique_ptr<grpc::Server> server;
    std::unique_ptr<Listener> listener;
    int port = 0;
    threads::Event stop;
    std::thread stall_thread;  // ends streams that have stalled
  };
  struct Metrics {
    monitoring::EndpointSockets sockets;
    std::unique_ptr<monitoring::Endpoint> endpoint;
  };

  ChildProcessOptions ChildOptions() const {
    return {.store = options_.data.store,
            .memory_limit_bytes = options_.filter.memory_limit_bytes,
            .time_limit = options_.filter.time_limit,
            .device = options_.filter.device_process};
  }
  /// Of the device that filters.
  std::string OtherBits() const {
    if (options_.filter.device != nullptr) return options_.filter.device->OtherBits();
    return options_.filter.device_process != nullptr ? options_.filter.device_process->other_bits() : "";
  }
  /// Opens access control where the data folder has it.
  absl::Status OpenAccess();
  std::shared_ptr<grpc::ServerCredentials> Credentials() const;
  absl::Status Listen();
  /// Whether other coordinators may use the ledger and the data folder.
  bool IsMember() const { return !options_.listen.empty() && !IsStoreInFolder(); }
  bool IsStoreInFolder() const {
    return options_.data.store.empty() || options_.data.store == ledger::kSqliteStore;
  }
  /// Takes the data folder, alone or as one of several.
  absl::Status OpenFolder();
  absl::Status OpenStore();
  absl::Status OpenCoordinator();
  void OpenPreviews();
  absl::Status JoinFarm();
  /// Names by which others reach a coordinator with access control.
  std::vector<std::string> CertifiedHosts() const;
  /// HOST:PORT by which they reach this one.
  std::string Address() const;
  absl::Status ShowMetrics();
  absl::Status ShowPage();
  absl::StatusOr<v1::PageLink> MakePageLink(const std::string& credential,
                                            const v1::CreatePageLinkRequest& request) const;
  /// Builds the gRPC server; calls inside the process can be made, and the listener is open but does not
  /// accept.
  absl::Status StartServices();
  absl::Status OpenListener(grpc::ServerBuilder* builder);
  absl::Status OpenAudit();
  /// Several coordinators must not write one file.
  std::string AuditName() const {
    return IsMember()
               ? absl::StrCat("audit.", absl::StrReplaceAll(Address(), {{":", "-"}, {"/", "-"}}), ".log")
               : "audit.log";
  }

  // In order of construction: each uses members above it.
  ServiceHealth health_;
  OwnLog log_;
  const ServerOptions options_;
  const DataFolder folder_;
  rpc::FileHandle lock_;
  Access access_;
  std::unique_ptr<ledger::JobStore> store_;
  Assets assets_;
  std::unique_ptr<FrameFinisher> finisher_;
  std::unique_ptr<Coordinator> coordinator_;
  Previews previews_;
  Member member_;
  Calls calls_;
  Metrics metrics_;
  std::unique_ptr<page::StatusPage> page_;
};

absl::Status ServerImpl::Open() {
  if (options_.lease < 2 * options_.heartbeat) {
    return absl::InvalidArgumentError(absl::StrCat("a lease of ", absl::FormatDuration(options_.lease),
                                                   " is shorter than two heartbeats of ",
                                                   absl::FormatDuration(options_.heartbeat)));
  }
  access_.security.insecure = options_.security.insecure;
  const bool has_access = access::HasAccessFolder(folder_.AccessPath());
  if (has_access && options_.security.insecure) {
    return absl::FailedPreconditionError(
        absl::StrCat("--insecure does not go with ", folder_.AccessPath(),
                     ": 'lumifold-server init' has set up encryption and identities there. Start without "
                     "--insecure, or with another data folder; to give all identities up, remove ",
                     folder_.AccessPath()));
  }
  if (!options_.listen.empty() && !has_access) {
    // Before anything is made.
    if (absl::Status status = rpc::CheckListenAddress(options_.listen, access_.security); !status.ok())
      return status;
  }
  for (const auto& open : {&ServerImpl::OpenFolder, &ServerImpl::OpenStore, &ServerImpl::OpenCoordinator}) {
    if (absl::Status status = (this->*open)(); !status.ok()) return status;
  }
  if (absl::Status status = Listen(); !status.ok()) return status;
  return ShowMetrics();
}

absl::Status ServerImpl::OpenFolder() {
  if (IsMember()) {
    if (absl::Status status = folder_.MakeFolders(); !status.ok()) return status;
    return OpenAccess();
  }
  absl::StatusOr<rpc::FileHandle> lock = folder_.Claim();
  if (!lock.ok()) return lock.status();
  lock_ = *std::move(lock);
  if (absl::Status status = OpenAccess(); !status.ok()) return status;
  return RemoveLeftovers(folder_);
}

absl::Status ServerImpl::OpenStore() {
  // A start writes to the ledger; on a full disk in the space that is kept for it.
  if (!IsMember() && folder_.FreeBytes().value_or(0) < options_.data.storage.reserve_bytes)
    ReserveFile(folder_.ReservePath(), options_.data.storage.reserve_bytes, options_.data.files).GiveUp();
  if (IsStoreInFolder()) {
    if (absl::Status status = CheckHasLedger(folder_); !status.ok()) return status;
  }
  absl::StatusOr<std::unique_ptr<ledger::JobStore>> store =
      ledger::OpenJobStore(options_.data.store, folder_.LedgerPath());
  if (!store.ok()) return IsStoreInFolder() ? AdviseRecovery(folder_, store.status()) : store.status();
  store_ = *std::move(store);
  return absl::OkStatus();
}

absl::Status ServerImpl::OpenCoordinator() {
  const std::string uploader = IsMember() ? absl::StrCat(absl::Hex(options_.random()), "-") : "";
  AssetLimits limits = options_.limits.assets;
  limits.uploader = uploader;
  assets_.store = std::make_unique<AssetStore>(folder_.AssetsPath(), folder_.IncomingPath(), options_.log,
                                               options_.data.files, limits);
  assets_.checks = std::make_unique<AssetChecks>(assets_.store.get());
  finisher_ = options_.filter.in_child_process
                  ? MakeChildProcessFinisher(folder_, ChildOptions())
                  : MakeInProcessFinisher(folder_, store_.get(), options_.now, options_.filter.device);
  StorageOptions storage = options_.data.storage;
  storage.max_open_logs = MaxOpenLogs();
  if (IsMember()) storage.reserve_bytes = 0;  // their ledger is not on the disk of their folder
  absl::StatusOr<std::unique_ptr<Coordinator>> coordinator = Coordinator::Create(
      {.workers = {.lease = options_.lease,
                   .heartbeat = options_.heartbeat,
                   .only_one = options_.only_one_worker},
       .finishing = {.processes = options_.filter.processes,
                     .threads = options_.filter.threads,
                     .memory_bytes = MemoryForPictures(),
                     .frame_memory_bytes = options_.filter.memory_limit_bytes,
                     .other_bits = OtherBits()},
       .now = options_.now,
       .wall_now = options_.wall_now,
       .random = options_.random,
       .log = options_.log,
       .storage = storage,
       .limits = options_.limits.jobs,
       .retention = options_.data.retention,
       .webhooks = options_.security.webhooks,
       .notify = {.on_storage_change = [this](bool is_writable) { health_.SetStorage(is_writable); },
                  .on_expelled = options_.farm.on_expelled},
       .job_log = {.labels = log_.labels, .events = &log_.events},
       .asset_checks = assets_.checks.get(),
       .insecure = !access_.security.uses_tls(),
       .is_member = IsMember()},
      folder_, store_.get(), assets_.store.get(), finisher_.get());
  if (!coordinator.ok())
    return IsStoreInFolder() ? AdviseRecovery(folder_, coordinator.status()) : coordinator.status();
  coordinator_ = *std::move(coordinator);
  OpenPreviews();
  return absl::OkStatus();
}

void ServerImpl::OpenPreviews() {
  const auto make = [this](const job::JobId& job, int32_t frame, const PreviewRequest& request) {
    return options_.filter.in_child_process
               ? RunMakePreview(&previews_.process, folder_, options_.filter.threads, job, frame, request)
               : MakePreview(folder_, *store_, job, frame, request,
                             filter::WithDevice(MakeTaskPool(1), options_.filter.device).get());
  };
  previews_.maker = std::make_unique<PreviewMaker>(
      PreviewOptions{.make = make,
                     .cancel = [this] { previews_.process.Cancel(); },
                     .count_units = [this](const job::JobId& job,
                                           int32_t frame) { return coordinator_->CountUnits(job, frame); }});
}

std::vector<std::string> ServerImpl::CertifiedHosts() const {
  return access_.control == nullptr ? std::vector<std::string>() : access_.control->Hosts();
}

std::string ServerImpl::Address() const {
  if (!options_.farm.advertise.empty()) return options_.farm.advertise;
  rpc::HostAndPort listen;
  if (!rpc::ParseHostAndPort(options_.listen, &listen).ok()) return options_.listen;
  const bool is_any = listen.host == "0.0.0.0" || listen.host == "::";
  std::array<char, 256> machine = {};
  if (is_any && gethostname(machine.data(), machine.size() - 1) == 0)
    return absl::StrCat(access::HostForOthers(CertifiedHosts(), machine.data()), ":", calls_.port);
  return absl::StrCat(options_.listen.substr(0, options_.listen.rfind(':')), ":", calls_.port);
}

absl::Status ServerImpl::JoinFarm() {
  absl::StatusOr<std::unique_ptr<ledger::Roster>> roster = ledger::OpenPostgresRoster(options_.data.store);
  if (!roster.ok()) return roster.status();
  member_.roster = *std::move(roster);
  const std::string address = Address();
  coordinator_->SetAddress(address);
  member_.membership = std::make_unique<cluster::Membership>(
      cluster::MembershipOptions{.owner = coordinator_->resources().owner,
                                 .address = address,
                                 .lease = options_.farm.failover,
                                 .log = options_.log},
      member_.roster.get(), &coordinator_->member());
  if (absl::Status status = member_.membership->Start(); !status.ok()) return status;
  cluster::FarmPeers::Options options{
      .security = {},
      .seal = nullptr,
      .wall_now = options_.wall_now,
      .self = coordinator_->resources().owner.epoch,
      .owner_of = [this](const job::JobId& job) { return coordinator_->OwnerOf(job); }};
  options.security.insecure = true;
  if (access_.control != nullptr) {
    options.security.ca_path = access_.security.ca_path;
    options.seal = &access_.control->known().seal();
  }
  member_.peers.Join(std::move(options), member_.membership.get());
  return absl::OkStatus();
}

absl::Status ServerImpl::ShowMetrics() {
  if (options_.metrics_address.empty()) return absl::OkStatus();
  absl::StatusOr<monitoring::EndpointSockets> sockets =
      monitoring::ListenForMetrics(options_.metrics_address);
  if (!sockets.ok()) return sockets.status();
  metrics_.sockets = *std::move(sockets);
  absl::StatusOr<std::unique_ptr<monitoring::Endpoint>> metrics = monitoring::Endpoint::Start(
      {.sockets = &metrics_.sockets,
       .sources = {monitoring::MakeFarmMetrics([this] {
                     monitoring::FarmMetrics farm = coordinator_->Metrics();
                     farm.page_viewers = page_ == nullptr ? 0 : page_->viewers();
                     return farm;
                   }),
                   coordinator_->resources().timings.source(), monitoring::MakeProcessMetrics()},
       .now = rpc::MonotonicNow});
  if (!metrics.ok()) return metrics.status();
  metrics_.endpoint = *std::move(metrics);
  options_.log->info("event=metrics address={}", metrics_.sockets.address);
  return absl::OkStatus();
}

absl::Status ServerImpl::ShowPage() {
  if (options_.page.address.empty()) return absl::OkStatus();
  const bool is_private = rpc::IsLoopback(options_.page.address);
  std::string certificate = options_.page.certificate;
  if (certificate.empty() && !is_private) certificate = access_.security.certificate_path;
  if (certificate.empty() && !is_private && !options_.security.insecure) {
    return absl::FailedPreconditionError(
        absl::StrCat("the status page at ", options_.page.address,
                     " needs encryption: --page-certificate FILE, or access control (lumifold-server init)"));
  }
  const absl::StatusOr<std::string> key = access_.control != nullptr
                                              ? absl::StatusOr<std::string>(access_.control->page_key())
                                              : identity::RandomBytes(kPageKeyBytes);
  if (!key.ok()) return key.status();
  std::set<std::string> names;
  for (const std::string& host : CertifiedHosts()) names.insert(absl::AsciiStrToLower(host));
  for (const std::string& address : {options_.page.address, options_.listen, Address()})
    names.insert(HostOf(address));
  absl::StatusOr<std::unique_ptr<page::StatusPage>> page =
      page::StatusPage::Start({.address = options_.page.address,
                               .certificate_path = certificate,
                               .host = is_private ? "127.0.0.1" : HostOf(Address()),
                               .names = std::move(names),
                               .channel = InProcessChannel(),
                               .session_key = *key,
                               .known = access_.control != nullptr ? &access_.control->known() : nullptr,
                               .wall_now = options_.wall_now});
  if (!page.ok()) return page.status();
  page_ = *std::move(page);
  options_.log->info("event=page address={} port={}", options_.page.address, page_->port());
  return absl::OkStatus();
}

absl::StatusOr<v1::PageLink> ServerImpl::MakePageLink(const std::string& credential,
                                                      const v1::CreatePageLinkRequest& request) const {
  if (page_ == nullptr)
    return absl::FailedPreconditionError("this coordinator shows no status page (--page-address)");
  return page_->MakeLink(credential, request);
}

absl::Status ServerImpl::OpenAccess() {
  if (options_.listen.empty()) return absl::OkStatus();  // all calls come from inside the process
  if (access::HasAccessFolder(folder_.AccessPath())) {
    absl::StatusOr<std::unique_ptr<access::AccessControl>> access =
        access::AccessControl::Open({.folder = folder_.AccessPath(),
                                     .store = options_.data.store,
                                     .certificate_lifetime = options_.security.certificate_lifetime,
                                     .wall_now = options_.wall_now,
                                     .log = options_.log});
    if (!access.ok()) return access.status();
    access_.control = *std::move(access);
    access_.security = access_.control->security();
    access_.callers = access::MakeCallers(&access_.control->known(), options_.wall_now);
    access_.control->Start();
  }
  if (absl::Status status = rpc::CheckListenAddress(options_.listen, access_.security); !status.ok())
    return status;
  if (!access_.security.uses_tls() && !rpc::IsLoopback(options_.listen)) {
    options_.log->warn(
        "event=insecure address={} meaning=\"whoever reaches it can do everything, and read everything\"",
        options_.listen);
  }
  return absl::OkStatus();
}

std::shared_ptr<grpc::ServerCredentials> ServerImpl::Credentials() const {
  if (access_.control == nullptr) return rpc::MakeServerCredentials(access_.security);
  return rpc::MakeServerCredentials(
      access_.security,
      access::MakeCallerCheck(
          &access_.control->known(), access_.authoriser.get(), options_.wall_now,
          [gate = calls_.gate.get()](const access::Identity& caller, absl::string_view rpc_path,
                                     const absl::Status& why) { gate->NoteRefusal(caller, rpc_path, why); }));
}

absl::Status ServerImpl::OpenAudit() {
  // Beside the identities where there are some.
  const std::string folder = access_.control != nullptr ? folder_.AccessPath() : folder_.root();
  absl::StatusOr<std::unique_ptr<access::AuditLog>> audit =
      access::AuditLog::Open({.path = folder + "/" + AuditName()});
  if (!audit.ok()) return audit.status();
  access_.audit = *std::move(audit);
  return absl::OkStatus();
}

absl::Status ServerImpl::OpenListener(grpc::ServerBuilder* builder) {
  if (absl::StartsWith(options_.listen, "unix:")) {  // its folder says who may connect
    builder->AddListeningPort(options_.listen, Credentials(), &calls_.port);
    return absl::OkStatus();
  }
  absl::StatusOr<std::unique_ptr<Listener>> listener =
      Listener::Open({.address = options_.listen,
                      .expects_tls = access_.security.uses_tls(),
                      .connections_per_address = options_.limits.connections.connections_per_address,
                      .connections = options_.limits.connections.connections,
                      .first_bytes = options_.limits.connections.handshake,
                      .now = rpc::MonotonicNow,
                      .log = options_.log});
  if (!listener.ok()) return listener.status();
  calls_.listener = *std::move(listener);
  calls_.port = calls_.listener->port();
  calls_.acceptor = builder->experimental().AddExternalConnectionAcceptor(
      grpc::ServerBuilder::experimental_type::ExternalConnectionType::FROM_FD, Credentials());
  return absl::OkStatus();
}

absl::Status ServerImpl::StartServices() {
  calls_.gate = std::make_unique<CallGate>(CallGate::Options{
      .callers = access_.callers.get(),
      .open_calls = access_.control != nullptr ? &access_.control->open_calls() : &access_.local_calls,
      .audit = access_.audit.get(),
      .limits = options_.limits.calls,
      .lease = options_.lease,
      .now = options_.now,
      .wall_now = options_.wall_now,
      .shut_out =
          [this](absl::string_view peer) {
            if (calls_.listener != nullptr) calls_.listener->ShutOut(peer);
          },
      .admitted =
          [this](absl::string_view peer) {
            if (calls_.listener != nullptr) calls_.listener->NoteCall(peer);
          }});
  calls_.services = MakeServices(
      {.submissions = &coordinator_->submissions(),
       .jobs = &coordinator_->jobs(),
       .changes = &coordinator_->changes(),
       .operators = &coordinator_->operators(),
       .workers = &coordinator_->workers(),
       .traffic = &coordinator_->resources().traffic,
       .epoch = coordinator_->resources().owner.epoch,
       .checks = assets_.checks.get(),
       .gate = calls_.gate.get(),
       .peers = &member_.peers,
       .previews = previews_.maker.get(),
       .make_link = [this](const std::string& credential, const v1::CreatePageLinkRequest& request) {
         return MakePageLink(credential, request);
       }});
  calls_.services.push_back(MakeAccessService(access_.control.get(), calls_.gate.get()));
  grpc::EnableDefaultHealthCheckService(true);
  grpc::reflection::InitProtoReflectionServerBuilderPlugin();
  grpc::ServerBuilder builder;
  SetConnectionLimits(options_.limits.connections, &builder);
  if (access_.control != nullptr) SetConnectionAge(options_.security.certificate_lifetime, &builder);
  if (!options_.listen.empty()) {
    if (absl::Status status = OpenListener(&builder); !status.ok()) return status;
  }
  for (const std::unique_ptr<grpc::Service>& service : calls_.services)
    builder.RegisterService(service.get());
  calls_.server = builder.BuildAndStart();
  if (calls_.server == nullptr || (!options_.listen.empty() && calls_.port == 0)) {
    return absl::UnavailableError(absl::StrCat("cannot listen on ", options_.listen,
                                               ": the port is taken, or the host is not this machine"));
  }
  return absl::OkStatus();
}

absl::Status ServerImpl::Listen() {
  if (!options_.listen.empty()) {
    if (absl::Status status = OpenAudit(); !status.ok()) return status;
  }
  if (absl::Status status = StartServices(); !status.ok()) return status;
  if (IsMember()) {  // before anyone can submit a job: it would have an owner that is no member
    if (absl::Status status = JoinFarm(); !status.ok()) return status;
  }
  health_.Begin(calls_.server->GetHealthCheckService());
  if (!options_.listen.empty()) {
    calls_.stall_thread = std::thread([this] {
      while (!calls_.stop.WaitFor(kStallInterval)) calls_.gate->EndStalledStreams();
    });
  }
  if (absl::Status status = ShowPage(); !status.ok()) return status;  // before any call asks for a link
  if (calls_.listener != nullptr) {
    calls_.listener->Start([this](int socket) {
      grpc::experimental::ExternalConnectionAcceptor::NewConnectionParameters connection;
      connection.fd = socket;
      calls_.acceptor->HandleNewConnection(&connection);
    });
  }
  if (!options_.listen.empty()) {
    options_.log->info("event=listening address={} port={} data={} encrypted={}", options_.listen,
                       calls_.port, logging::Quoted(options_.data.folder), access_.security.uses_tls());
  }
  return absl::OkStatus();
}

std::shared_ptr<grpc::Channel> ServerImpl::InProcessChannel() {
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(rpc::kMaxMessageBytes);
  arguments.SetMaxSendMessageSize(rpc::kMaxMessageBytes);
  return calls_.server->InProcessChannel(arguments);
}

void ServerImpl::Shutdown() {
  health_.Stop();
  if (member_.membership != nullptr) member_.membership->Stop();
  if (page_ != nullptr) page_->Stop();
  if (coordinator_ != nullptr) coordinator_->StopLeasing();
  metrics_.endpoint.reset();
  metrics_.sockets = {};
  calls_.stop.Notify();
  if (calls_.stall_thread.joinable()) calls_.stall_thread.join();
  if (access_.control != nullptr) access_.control->Stop();
  if (assets_.checks != nullptr) assets_.checks->Stop();    // calls that wait for it get an answer
  if (previews_.maker != nullptr) previews_.maker->Stop();  // as these
  if (calls_.listener != nullptr) calls_.listener->Stop();
  if (calls_.server != nullptr) calls_.server->Shutdown(rpc::MonotonicDeadline(kGrace));
  if (coordinator_ != nullptr) coordinator_->Shutdown();
  if (member_.membership != nullptr && !std::exchange(member_.has_left, true)) member_.membership->Leave();
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
