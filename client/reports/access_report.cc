#include "client/reports/access_report.h"

#include <nlohmann/json.hpp>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"

#include "client/cli/json_line.h"
#include "proto/rpc/bounded_text.h"

namespace lumifold::client {
namespace {

std::string ScopeName(int scope) {
  switch (scope) {
    case v1::ACCESS_SCOPE_READ:
      return "read";
    case v1::ACCESS_SCOPE_SUBMIT:
      return "submit";
    case v1::ACCESS_SCOPE_ADMIN:
      return "admin";
    default:
      return "unknown";
  }
}

template <typename Message>
std::vector<std::string> ScopeNames(const Message& message) {
  std::vector<std::string> names;
  for (const int scope : message.scopes()) names.push_back(ScopeName(scope));
  return names;
}

std::string KindName(v1::HolderKind kind) {
  switch (kind) {
    case v1::HOLDER_KIND_PERSON:
      return "person";
    case v1::HOLDER_KIND_WORKER:
      return "worker";
    case v1::HOLDER_KIND_LOCAL:
      return "local";
    default:
      return "unknown";
  }
}

std::string FormName(v1::CredentialForm form) {
  switch (form) {
    case v1::CREDENTIAL_FORM_INVITE:
      return "invite";
    case v1::CREDENTIAL_FORM_TOKEN:
      return "token";
    case v1::CREDENTIAL_FORM_CERTIFICATE:
      return "certificate";
    default:
      return "unknown";
  }
}

std::string StateName(v1::CredentialState state) {
  switch (state) {
    case v1::CREDENTIAL_STATE_VALID:
      return "valid";
    case v1::CREDENTIAL_STATE_EXPIRED:
      return "expired";
    case v1::CREDENTIAL_STATE_REVOKED:
      return "revoked";
    case v1::CREDENTIAL_STATE_USED:
      return "used";
    default:
      return "unknown";
  }
}

std::string LocalTimeText(int64_t unix_ms) {
  return absl::FormatTime("%Y-%m-%d %H:%M:%S", absl::FromUnixMillis(unix_ms), absl::LocalTimeZone());
}

}  // namespace

absl::StatusOr<v1::AccessScope> ParseScope(const std::string& name) {
  for (const v1::AccessScope scope :
       {v1::ACCESS_SCOPE_READ, v1::ACCESS_SCOPE_SUBMIT, v1::ACCESS_SCOPE_ADMIN}) {
    if (ScopeName(scope) == name) return scope;
  }
  return absl::InvalidArgumentError(absl::StrCat("expected read, submit or admin; got '", name, "'"));
}

std::string WhoAmIText(const v1::WhoAmIResponse& caller) {
  std::string text = absl::StrCat("name: ", caller.name(), "\nkind: ", KindName(caller.kind()),
                                  "\nscopes: ", absl::StrJoin(ScopeNames(caller), ", "), "\n");
  if (!caller.id().empty()) absl::StrAppend(&text, "id: ", caller.id(), "\n");
  if (caller.expires_unix_ms() > 0)
    absl::StrAppend(&text, "expires: ", LocalTimeText(caller.expires_unix_ms()), "\n");
  return text;
}

std::string WhoAmIJson(const v1::WhoAmIResponse& caller) {
  nlohmann::ordered_json json;
  json["name"] = caller.name();
  json["kind"] = KindName(caller.kind());
  json["scopes"] = ScopeNames(caller);
  json["id"] = caller.id();
  json["expires_unix_ms"] = caller.expires_unix_ms();
  return JsonLine(json);
}

std::string InviteJson(const v1::CreateInviteResponse& invite) {
  nlohmann::ordered_json json;
  json["code"] = invite.code();
  json["id"] = invite.id();
  json["expires_unix_ms"] = invite.expires_unix_ms();
  return JsonLine(json);
}

std::string IdentityTableHead() {
  return absl::StrFormat("%-32s %-11s %-6s %-7s %-19s %-17s %s\n", "ID", "FORM", "KIND", "STATE", "EXPIRES",
                         "SCOPES", "NAME");
}

std::string IdentityTableLine(const v1::Credential& credential) {
  const std::string scopes = absl::StrJoin(ScopeNames(credential), ",");
  return absl::StrFormat("%-32s %-11s %-6s %-7s %-19s %-17s %s\n", credential.id(),
                         FormName(credential.form()), KindName(credential.kind()),
                         StateName(credential.state()), LocalTimeText(credential.expires_unix_ms()),
                         scopes.empty() ? "-" : scopes, rpc::Printable(credential.name()));
}

std::string IdentityJson(const v1::Credential& credential) {
  nlohmann::ordered_json json;
  json["id"] = credential.id();
  json["form"] = FormName(credential.form());
  json["kind"] = KindName(credential.kind());
  json["name"] = credential.name();
  json["scopes"] = ScopeNames(credential);
  json["state"] = StateName(credential.state());
  json["created_unix_ms"] = credential.created_unix_ms();
  json["expires_unix_ms"] = credential.expires_unix_ms();
  return JsonLine(json);
}

}  // namespace lumifold::client
