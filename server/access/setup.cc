#include "server/access/setup.h"

#include <unistd.h>

#include <array>
#include <memory>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

namespace lumifold::access {
namespace {

constexpr char kFirstAdmin[] = "admin";
constexpr char kFirstWorker[] = "worker-1";
constexpr int kPort = 7700;

std::string HostName() {
  std::array<char, 256> host = {};
  gethostname(host.data(), host.size() - 1);
  return CheckHost(host.data()).ok() ? host.data() : "localhost";
}

/// As an argument of a shell.
std::string Quoted(const std::string& text) {
  constexpr absl::string_view kPlain =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789/._-+:@%,";
  if (!text.empty() && text.find_first_not_of(kPlain.data()) == std::string::npos) return text;
  std::string quoted = "'";
  for (const char c : text) absl::StrAppend(&quoted, c == '\'' ? "'\\''" : std::string(1, c));
  return quoted + "'";
}

absl::StatusOr<std::string> Invite(AccessControl& access, v1::HolderKind kind, const std::string& name) {
  v1::CreateInviteRequest request;
  request.set_kind(kind);
  request.set_name(name);
  if (kind == v1::HOLDER_KIND_PERSON) {
    for (const v1::AccessScope scope :
         {v1::ACCESS_SCOPE_READ, v1::ACCESS_SCOPE_SUBMIT, v1::ACCESS_SCOPE_ADMIN})
      request.add_scopes(scope);
  }
  absl::StatusOr<v1::CreateInviteResponse> response = access.CreateInvite(LocalIdentity(), request);
  if (!response.ok()) return response.status();
  return response->code();
}

}  // namespace

absl::StatusOr<std::string> SetUp(const AccessOptions& options, const std::string& data_dir,
                                  std::vector<std::string> names) {
  if (names.empty()) names.push_back(HostName());
  if (absl::Status status = MakeAccessFolder(options, names); !status.ok()) return status;
  const absl::StatusOr<std::unique_ptr<AccessControl>> access = AccessControl::Open(options);
  if (!access.ok()) return access.status();
  const absl::StatusOr<std::string> admin = Invite(**access, v1::HOLDER_KIND_PERSON, kFirstAdmin);
  if (!admin.ok()) return admin.status();
  const absl::StatusOr<std::string> worker = Invite(**access, v1::HOLDER_KIND_WORKER, kFirstWorker);
  if (!worker.ok()) return worker.status();
  const bool is_ip6 = absl::StrContains(names.front(), ":");
  const std::string address = absl::StrCat(is_ip6 ? "[" : "", names.front(), is_ip6 ? "]" : "", ":", kPort);
  return absl::StrCat("The coordinator is set up. Start it here:\n\n  lumifold-server --data ",
                      Quoted(data_dir), " --listen 0.0.0.0:", kPort,
                      "\n\nThe codes below are valid once and for 24 hours.\n\nOn your own machine, as '",
                      kFirstAdmin, "':\n\n  lumifold login ", address, " ", *admin, "\n\nOn a worker, as '",
                      kFirstWorker, "':\n\n  lumifold-worker enroll ", address, " ", *worker,
                      "\n\nMore people and workers are invited with 'lumifold invite'.\n");
}

absl::StatusOr<std::string> InviteAdmin(const AccessOptions& options, const std::string& name) {
  const absl::StatusOr<std::unique_ptr<AccessControl>> access = AccessControl::Open(options);
  if (!access.ok()) return access.status();
  return Invite(**access, v1::HOLDER_KIND_PERSON, name);
}

}  // namespace lumifold::access
