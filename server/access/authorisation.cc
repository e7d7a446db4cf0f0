#include "server/access/authorisation.h"

#include <algorithm>

#include "absl/strings/str_cat.h"

namespace lumifold::access {
namespace {

using Who = std::array<Access, kRoles.size()>;

// In the order of kRoles: nobody, read, submit, admin, worker, local.
constexpr Who kAnyone = {Access::kYes, Access::kYes, Access::kYes, Access::kYes, Access::kYes, Access::kYes};
constexpr Who kKnown = {Access::kNo, Access::kYes, Access::kYes, Access::kYes, Access::kYes, Access::kYes};
constexpr Who kReaders = {Access::kNo, Access::kYes, Access::kYes, Access::kYes, Access::kNo, Access::kYes};
constexpr Who kReadersOfJobs = {Access::kNo,  Access::kOwn, Access::kOwn,
                                Access::kYes, Access::kNo,  Access::kYes};
constexpr Who kSubmitters = {Access::kNo, Access::kNo, Access::kYes, Access::kYes, Access::kNo, Access::kYes};
constexpr Who kOwners = {Access::kNo, Access::kNo, Access::kOwn, Access::kYes, Access::kNo, Access::kYes};
constexpr Who kAdmins = {Access::kNo, Access::kNo, Access::kNo, Access::kYes, Access::kNo, Access::kYes};
constexpr Who kWorkers = {Access::kNo, Access::kNo, Access::kNo, Access::kNo, Access::kYes, Access::kYes};

constexpr bool kChanges = true;
constexpr bool kCheckedByService = true;

constexpr std::array kRules = {
    Rule{"/grpc.health.v1.Health/Check", kAnyone},
    Rule{"/grpc.health.v1.Health/Watch", kAnyone},
    Rule{"/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo", kReaders},
    Rule{"/lumifold.v1.AccessService/CreateInvite", kAdmins, kChanges},
    Rule{"/lumifold.v1.AccessService/Enroll", kAnyone, kChanges},
    Rule{"/lumifold.v1.AccessService/ListIdentities", kAdmins},
    Rule{"/lumifold.v1.AccessService/Login", kAnyone, kChanges},
    Rule{"/lumifold.v1.AccessService/RenewCertificate", kKnown, kChanges},
    Rule{"/lumifold.v1.AccessService/Revoke", kAdmins, kChanges},
    Rule{"/lumifold.v1.AccessService/WhoAmI", kKnown},
    Rule{"/lumifold.v1.FarmService/AddSamples", kOwners, kChanges},
    Rule{"/lumifold.v1.FarmService/BlockWorker", kAdmins, kChanges},
    Rule{"/lumifold.v1.FarmService/CancelJob", kOwners, kChanges},
    Rule{"/lumifold.v1.FarmService/CreatePageLink", kReadersOfJobs, kChanges},
    Rule{"/lumifold.v1.FarmService/DeleteJob", kOwners, kChanges},
    Rule{"/lumifold.v1.FarmService/DownloadResult", kReadersOfJobs},
    Rule{"/lumifold.v1.FarmService/DrainWorker", kAdmins, kChanges},
    Rule{"/lumifold.v1.FarmService/ExplainJob", kReadersOfJobs},
    Rule{"/lumifold.v1.FarmService/FindMissingAssets", kSubmitters},
    Rule{"/lumifold.v1.FarmService/FindUpload", kSubmitters},
    Rule{"/lumifold.v1.FarmService/GetJob", kReadersOfJobs},
    Rule{"/lumifold.v1.FarmService/GetLog", kReadersOfJobs},
    Rule{"/lumifold.v1.FarmService/GetPreview", kReadersOfJobs},
    Rule{"/lumifold.v1.FarmService/GetServerStatus", kReaders},
    Rule{"/lumifold.v1.FarmService/GetUsage", kReadersOfJobs},
    Rule{"/lumifold.v1.FarmService/ListJobs", kReadersOfJobs},
    Rule{"/lumifold.v1.FarmService/ListWorkers", kReaders},
    Rule{"/lumifold.v1.FarmService/PauseJob", kOwners, kChanges},
    Rule{"/lumifold.v1.FarmService/ReadmitWorker", kAdmins, kChanges},
    Rule{"/lumifold.v1.FarmService/ResumeJob", kOwners, kChanges},
    Rule{"/lumifold.v1.FarmService/RetryJob", kOwners, kChanges},
    Rule{"/lumifold.v1.FarmService/SetJobPriority", kOwners, kChanges},
    Rule{"/lumifold.v1.FarmService/SubmitJob", kOwners, kChanges},
    Rule{"/lumifold.v1.FarmService/UploadAsset", kSubmitters, kChanges, kCheckedByService},
    Rule{"/lumifold.v1.FarmService/WatchJob", kReadersOfJobs},
    Rule{"/lumifold.v1.WorkerService/DeliverResult", kWorkers, kChanges, kCheckedByService},
    Rule{"/lumifold.v1.WorkerService/FetchAsset", kWorkers},
    Rule{"/lumifold.v1.WorkerService/FetchSpec", kWorkers},
    Rule{"/lumifold.v1.WorkerService/FetchUnits", kWorkers},
    Rule{"/lumifold.v1.WorkerService/Work", kWorkers, kChanges, kCheckedByService},
};

constexpr bool IsBefore(const Rule& left, const Rule& right) { return left.rpc_path < right.rpc_path; }
static_assert(std::is_sorted(kRules.begin(), kRules.end(), IsBefore), "FindRule searches by halves");

class RuleAuthoriser final : public Authoriser {
 public:
  absl::Status Check(const Identity& caller, absl::string_view rpc_path) const override {
    const Role role = RoleOf(caller);
    if (AccessOf(role, rpc_path) != Access::kNo) return absl::OkStatus();
    // The path is the caller's text: it is not repeated where the table does not have it.
    const absl::string_view call = FindRule(rpc_path) == nullptr ? "this call" : rpc_path.substr(1);
    return absl::PermissionDeniedError(absl::StrCat(
        role == Role::kWorker ? "a worker" : absl::StrCat("a caller with the role ", NameOf(role)),
        " may not make ", call));
  }
};

}  // namespace

absl::string_view NameOf(Role role) {
  static constexpr std::array<absl::string_view, kRoles.size()> kNames = {"nobody", "read",   "submit",
                                                                          "admin",  "worker", "local"};
  return kNames[static_cast<size_t>(role)];
}

Role RoleOf(const Identity& caller) {
  if (caller.kind == IdentityKind::kLocal) return Role::kLocal;
  if (caller.kind == IdentityKind::kWorker) return Role::kWorker;
  if (caller.scopes.contains(Scope::kAdmin)) return Role::kAdmin;
  if (caller.scopes.contains(Scope::kSubmit)) return Role::kSubmit;
  return caller.scopes.contains(Scope::kRead) ? Role::kRead : Role::kNobody;
}

absl::Span<const Rule> Rules() { return kRules; }

const Rule* FindRule(absl::string_view rpc_path) {
  const auto found = std::lower_bound(kRules.begin(), kRules.end(), Rule{rpc_path, {}}, IsBefore);
  return found != kRules.end() && found->rpc_path == rpc_path ? &*found : nullptr;
}

Access AccessOf(Role role, absl::string_view rpc_path) {
  const Rule* rule = FindRule(rpc_path);
  return rule == nullptr ? Access::kNo : rule->access[static_cast<size_t>(role)];
}

bool ReachesAllJobs(const Identity& caller) {
  const Role role = RoleOf(caller);
  return role == Role::kAdmin || role == Role::kLocal;
}

std::unique_ptr<Authoriser> MakeAuthoriser() { return std::make_unique<RuleAuthoriser>(); }

}  // namespace lumifold::access
