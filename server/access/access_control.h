#pragma once

#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "lumifold/v1/access.pb.h"
#include "proto/identity/certificate.h"
#include "proto/rpc/credentials.h"
#include "proto/threads/event.h"
#include "server/access/access_store.h"
#include "server/access/certificate_authority.h"
#include "server/access/identity.h"
#include "server/access/known_credentials.h"
#include "server/access/open_calls.h"

namespace spdlog {
class logger;
}  // namespace spdlog

namespace grpc {
class AuthMetadataProcessor;
}  // namespace grpc

namespace lumifold::access {

/// 90 days: of certificates of coordinators and workers, and, unless it is said, of tokens.
inline constexpr absl::Duration kCredentialLifetime = absl::Hours(24 * 90);
inline constexpr absl::Duration kInviteLifetime = absl::Hours(24);

struct AccessOptions {
  /// DIR/access, as MakeAccessFolder left it.
  std::string folder;
  /// Name of the store, see AccessStore::Open.
  std::string store;
  /// Lifetime of the certificates that it signs.
  absl::Duration certificate_lifetime = kCredentialLifetime;
  std::function<absl::Time()> wall_now = identity::ValidityClock;
  std::shared_ptr<spdlog::logger> log;
};

/// Whether a coordinator's folder has access control: DIR/access exists.
bool HasAccessFolder(const std::string& folder);

/// Makes access control of a new coordinator: authority, names of the server, its certificate and the store.
/// Errors: kAlreadyExists where the folder exists; kInvalidArgument for a host; those of files and store.
absl::Status MakeAccessFolder(const AccessOptions& options, const std::vector<std::string>& hosts);

/// Access control of a running coordinator. Every second it learns what was made and revoked, also by others
/// over the same store, ends the calls of those who have lost their identity, and renews the server's
/// certificate when two thirds of its life are over. gRPC reads the new file.
/// Threads: safe.
class AccessControl {
 public:
  /// Errors: those of files and store; kInvalidArgument for malformed ones.
  static absl::StatusOr<std::unique_ptr<AccessControl>> Open(AccessOptions options);
  ~AccessControl() { Stop(); }

  /// For the server's credentials.
  rpc::Security security() const;
  const KnownCredentials& known() const { return known_; }
  /// Secret bytes for the sessions of the status page, which all coordinators of this authority have.
  std::string page_key() const { return authority_->SecretFor("sessions of the status page"); }
  OpenCalls& open_calls() { return open_calls_; }
  /// The names of the server's certificate, those of HostsOfServer first. Empty where they cannot be read.
  std::vector<std::string> Hosts() const;

  // The calls of AccessService. `caller` was let through by the authoriser.
  absl::StatusOr<v1::CertificateResponse> Enroll(const v1::EnrollRequest& request);
  absl::StatusOr<v1::LoginResponse> Login(const v1::LoginRequest& request);
  absl::StatusOr<v1::CertificateResponse> RenewCertificate(const Identity& caller,
                                                           const v1::RenewCertificateRequest& request);
  absl::StatusOr<v1::CreateInviteResponse> CreateInvite(const Identity& caller,
                                                        const v1::CreateInviteRequest& request);
  absl::StatusOr<v1::ListIdentitiesResponse> ListIdentities(const v1::ListIdentitiesRequest& request);
  absl::StatusOr<v1::RevokeResponse> Revoke(const Identity& caller, const v1::RevokeRequest& request);

  /// Starts the thread that does what is said above, and ends it.
  void Start();
  void Stop();
  /// What the thread does each second.
  void Refresh();

 private:
  AccessControl(AccessOptions options, std::unique_ptr<CertificateAuthority> authority,
                std::unique_ptr<AccessStore> store)
      : options_(std::move(options)),
        authority_(std::move(authority)),
        store_(std::move(store)),
        known_(authority_->SecretFor("calls that coordinators forward")) {}
  absl::Status RenewServerCertificate();
  absl::Status ReadChanges();
  /// Signs the key of a request for `holder`, whose kind, name, scopes and token_lifetime count. Returns what
  /// the store keeps of the certificate, and the certificate.
  struct SignedKey {
    NewCredential credential;
    std::string pem;
  };
  absl::StatusOr<SignedKey> SignKey(const Credential& holder, const std::string& request_pem) const;
  v1::CertificateResponse ResponseFor(const SignedKey& made) const;

  const AccessOptions options_;
  const std::unique_ptr<CertificateAuthority> authority_;
  absl::Mutex mutex_;
  const std::unique_ptr<AccessStore> store_ ABSL_PT_GUARDED_BY(mutex_);
  int64_t read_version_ ABSL_GUARDED_BY(mutex_) = -1;
  bool is_store_lost_ ABSL_GUARDED_BY(mutex_) = false;
  KnownCredentials known_;
  OpenCalls open_calls_;
  threads::Event stop_;
  std::thread thread_;
};

/// The answer of AccessService.WhoAmI. `access` is null for a coordinator without access control.
v1::WhoAmIResponse DescribeCaller(const AccessControl* access, const Identity& caller);

}  // namespace lumifold::access
