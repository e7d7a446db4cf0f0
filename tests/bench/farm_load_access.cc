#include "tests/bench/farm_load_access.h"

#include <spdlog/sinks/null_sink.h>
#include <spdlog/spdlog.h>

#include <memory>

#include "proto/identity/join.h"
#include "proto/identity/profile.h"
#include "server/access/access_control.h"

namespace lumifold::bench {
namespace {

absl::StatusOr<std::string> Invite(access::AccessControl& access, v1::HolderKind kind) {
  v1::CreateInviteRequest request;
  request.set_kind(kind);
  request.set_name("load");
  if (kind == v1::HOLDER_KIND_PERSON) {
    request.add_scopes(v1::ACCESS_SCOPE_READ);
    request.add_scopes(v1::ACCESS_SCOPE_SUBMIT);
  }
  const absl::StatusOr<v1::CreateInviteResponse> invite =
      access.CreateInvite(access::LocalIdentity(), request);
  if (!invite.ok()) return invite.status();
  return invite->code();
}

}  // namespace

absl::StatusOr<LoadAccess> LoadAccess::SetUp(const std::string& data, const std::string& config) {
  const access::AccessOptions options = {
      .folder = data + "/access",
      .store = "",
      .log = std::make_shared<spdlog::logger>("", std::make_shared<spdlog::sinks::null_sink_mt>())};
  if (absl::Status status = access::MakeAccessFolder(options, {}); !status.ok()) return status;
  const absl::StatusOr<std::unique_ptr<access::AccessControl>> access = access::AccessControl::Open(options);
  if (!access.ok()) return access.status();
  const absl::StatusOr<std::string> client = Invite(**access, v1::HOLDER_KIND_PERSON);
  if (!client.ok()) return client.status();
  const absl::StatusOr<std::string> worker = Invite(**access, v1::HOLDER_KIND_WORKER);
  if (!worker.ok()) return worker.status();
  LoadAccess made;
  made.config_ = config;
  made.client_code_ = *client;
  made.worker_code_ = *worker;
  return made;
}

absl::Status LoadAccess::Join(const std::string& address) {
  if (client_code_.empty()) return absl::OkStatus();
  const identity::Profiles profiles(config_);
  absl::Status status = identity::Login(profiles, "client", address, client_code_).status();
  if (status.ok()) status = identity::Enroll(profiles, "worker", address, worker_code_).status();
  if (!status.ok()) return status;
  const absl::StatusOr<rpc::Security> client = profiles.SecurityOf("client");
  if (!client.ok()) return client.status();
  const absl::StatusOr<rpc::Security> worker = profiles.SecurityOf("worker");
  if (!worker.ok()) return worker.status();
  client_ = *client;
  worker_ = *worker;
  return absl::OkStatus();
}

}  // namespace lumifold::bench
