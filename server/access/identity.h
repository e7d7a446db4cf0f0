#pragma once

#include <set>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace grpc {
class CallbackServerContext;
}  // namespace grpc

namespace lumifold::access {

enum class Scope { kRead, kSubmit, kAdmin };

enum class IdentityKind {
  kLocal,   // whoever reaches a coordinator without access control, or calls it inside the process
  kPerson,  // by token or certificate
  kWorker,  // by certificate
};

/// Who makes a call.
struct Identity {
  IdentityKind kind = IdentityKind::kPerson;
  std::string name;
  /// A local caller has all, a worker none.
  std::set<Scope> scopes;
  /// Of the token, or the serial number of the certificate; empty for the local caller.
  std::string id;

  bool operator==(const Identity&) const = default;
};

/// The only caller of a coordinator without access control: "local", with all scopes.
Identity LocalIdentity();

/// What one caller has with all its tokens or certificates: "person/ann", "worker/node-7", "local/local".
std::string KeyOf(const Identity& caller);

/// Tells who makes a call. The answer cannot be a property of grpc::AuthContext: that belongs to the
/// connection, over which calls with different tokens may come at the same time.
/// Threads: safe.
class Callers {
 public:
  virtual ~Callers() = default;

  /// Errors: kUnauthenticated where the caller's token or certificate is missing, has expired or was revoked,
  /// also since the call began.
  virtual absl::StatusOr<Identity> Of(const grpc::CallbackServerContext& context) const = 0;
};

/// Says what a caller may do, before any of the call's messages is parsed.
/// Threads: safe, and must not block: it runs on a thread that serves connections.
class Authoriser {
 public:
  virtual ~Authoriser() = default;

  /// `rpc_path`: "/lumifold.v1.FarmService/GetJob". OK where the caller may make the call.
  /// Errors: kPermissionDenied.
  virtual absl::Status Check(const Identity& caller, absl::string_view rpc_path) const = 0;
};

}  // namespace lumifold::access
