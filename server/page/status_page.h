#pragma once

#include <grpcpp/channel.h>

#include <functional>
#include <memory>
#include <set>
#include <string>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "lumifold/v1/farm.pb.h"
#include "server/access/known_credentials.h"

namespace lumifold::page {

struct StatusPageOptions {
  /// HOST:PORT where it listens; port 0: a free port.
  std::string address;
  /// PEM file with key and certificates; empty: plain text.
  std::string certificate_path;
  /// Of links.
  std::string host;
  /// Names of this machine, in lower case; addresses and localhost need not be named.
  std::set<std::string> names;
  /// To the coordinator within the process.
  std::shared_ptr<grpc::Channel> channel;
  /// Secret bytes that seal sessions.
  std::string session_key;
  /// Who has the credentials of sessions and the farm's tokens; must outlive the page. Null: whoever calls is
  /// the local caller, and there are no tokens.
  const access::KnownCredentials* known = nullptr;
  std::function<absl::Time()> wall_now;
  /// Watching browsers at a time.
  int viewers = 128;
};

/// The status page: static files, and an interface in JSON for them, see docs/page.md. All it does it asks
/// the coordinator for, as a client does, in the name of whoever made the link.
/// Threads: safe; it has its own.
class StatusPage {
 public:
  /// Errors: kInvalidArgument for the address; kUnavailable where it cannot listen there or use the
  /// certificate.
  static absl::StatusOr<std::unique_ptr<StatusPage>> Start(StatusPageOptions options);
  virtual ~StatusPage() = default;
  /// Ends all connections. Later calls have no effect.
  virtual void Stop() = 0;

  /// A link for the owner of a credential, empty for the local caller, who may see the job of the request.
  /// Errors: kInvalidArgument for the hours.
  virtual absl::StatusOr<v1::PageLink> MakeLink(const std::string& credential,
                                                const v1::CreatePageLinkRequest& request) const = 0;
  /// Browsers that watch now.
  virtual int viewers() const = 0;
  virtual int port() const = 0;
};

}  // namespace lumifold::page
