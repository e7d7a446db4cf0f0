#include "proto/rpc/credentials.h"

#include <arpa/inet.h>
#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>
#include <grpcpp/security/server_credentials.h>
#include <grpcpp/security/tls_certificate_provider.h>
#include <grpcpp/security/tls_certificate_verifier.h>
#include <grpcpp/security/tls_credentials_options.h>

#include <algorithm>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "proto/rpc/limits.h"
#include "proto/rpc/reconnect_pauses.h"

namespace lumifold::rpc {
namespace {

// Time for one attempt to connect, handshake included. gRPC's default of 20 s delays the next attempt where
// packets vanish.
constexpr absl::Duration kConnectTimeout = absl::Seconds(5);

int Milliseconds(absl::Duration duration) { return static_cast<int>(absl::ToInt64Milliseconds(duration)); }

// How often the certificate files are looked at. A renewed one has a third of its predecessor's life to be
// noticed.
constexpr unsigned kCertificateRefreshSeconds = 2;

std::shared_ptr<grpc::experimental::CertificateProviderInterface> WatchCertificates(
    const Security& security) {
  if (security.certificate_path.empty()) {
    return std::make_shared<grpc::experimental::FileWatcherCertificateProvider>(security.ca_path,
                                                                                kCertificateRefreshSeconds);
  }
  return std::make_shared<grpc::experimental::FileWatcherCertificateProvider>(
      security.certificate_path, security.certificate_path, security.ca_path, kCertificateRefreshSeconds);
}

}  // namespace

bool IsLoopback(const std::string& address) {
  if (absl::StartsWith(address, "unix:")) return true;
  const std::string host = address.substr(0, address.rfind(':'));
  in_addr ip4 = {};
  // Only a literal address: "127.example.org" is a name that may resolve to any address.
  const bool is_ip4_loopback = inet_pton(AF_INET, host.c_str(), &ip4) == 1 && absl::StartsWith(host, "127.");
  return is_ip4_loopback || host == "localhost" || host == "[::1]";
}

absl::Status ParseHostAndPort(const std::string& address, HostAndPort* result) {
  const absl::Status malformed = absl::InvalidArgumentError(absl::StrCat("'", address, "' is not HOST:PORT"));
  const size_t colon = address.rfind(':');
  if (colon == std::string::npos || colon == 0) return malformed;
  std::string host = address.substr(0, colon);
  const bool bracketed = host.front() == '[' && host.back() == ']';
  if (bracketed) {
    host = host.substr(1, host.size() - 2);
  } else if (absl::StrContains(host, ":")) {
    return malformed;
  }
  const std::string digits = address.substr(colon + 1);
  const bool is_number = std::all_of(digits.begin(), digits.end(), absl::ascii_isdigit);
  int port = -1;
  if (!is_number || !absl::SimpleAtoi(digits, &port) || port > 65535) return malformed;
  *result = {.host = std::move(host), .port = port};
  return absl::OkStatus();
}

absl::Status CheckListenAddress(const std::string& address, const Security& security) {
  HostAndPort parsed;
  if (!absl::StartsWith(address, "unix:")) {
    if (absl::Status status = ParseHostAndPort(address, &parsed); !status.ok()) return status;
  }
  if (!IsLoopback(address) && !security.uses_tls() && !security.insecure) {
    return absl::FailedPreconditionError(absl::StrCat(
        "listening on ", address,
        " would accept connections of other machines without encryption; set up certificates with "
        "'lumifold-server init', or allow it with --insecure"));
  }
  return absl::OkStatus();
}

absl::Status CheckServerAddress(const std::string& address, const Security& security) {
  if (IsLoopback(address) || security.uses_tls() || security.insecure) return absl::OkStatus();
  return absl::FailedPreconditionError(absl::StrCat(
      "there is no profile for the coordinator at ", address,
      ", and without one all would go there unencrypted; see 'lumifold login' and 'lumifold-worker "
      "enroll', or allow it with --insecure"));
}

std::shared_ptr<grpc::ServerCredentials> MakeServerCredentials(
    const Security& security, std::shared_ptr<grpc::AuthMetadataProcessor> processor) {
  if (!security.uses_tls()) return grpc::InsecureServerCredentials();
  grpc::experimental::TlsServerCredentialsOptions options(WatchCertificates(security));
  options.watch_root_certs();
  options.watch_identity_key_cert_pairs();
  // People come with a token and without a certificate; a certificate that is given must be one of ours.
  options.set_cert_request_type(GRPC_SSL_REQUEST_CLIENT_CERTIFICATE_AND_VERIFY);
  std::shared_ptr<grpc::ServerCredentials> credentials = grpc::experimental::TlsServerCredentials(options);
  if (processor != nullptr) credentials->SetAuthMetadataProcessor(std::move(processor));
  return credentials;
}

std::shared_ptr<grpc::ChannelCredentials> MakeChannelCredentials(const Security& security) {
  if (!security.uses_tls()) return grpc::InsecureChannelCredentials();
  grpc::experimental::TlsChannelCredentialsOptions options;
  options.set_certificate_provider(WatchCertificates(security));
  options.watch_root_certs();
  if (!security.certificate_path.empty()) options.watch_identity_key_cert_pairs();
  options.set_certificate_verifier(std::make_shared<grpc::experimental::HostNameCertificateVerifier>());
  std::shared_ptr<grpc::ChannelCredentials> credentials = grpc::experimental::TlsCredentials(options);
  if (security.token.empty()) return credentials;
  return grpc::CompositeChannelCredentials(credentials, grpc::AccessTokenCredentials(security.token));
}

std::shared_ptr<grpc::Channel> MakeChannel(const std::string& address, const Security& security,
                                           const KeepAlive& keep_alive) {
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(kMaxMessageBytes);
  arguments.SetMaxSendMessageSize(kMaxMessageBytes);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, Milliseconds(keep_alive.time));
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, Milliseconds(keep_alive.timeout));
  // By default gRPC sends two pings, and no more before it has data to send.
  arguments.SetInt(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);
  // gRPC's default lets the pauses between attempts grow to two minutes. It adds jitter of 20 %.
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, Milliseconds(kReconnectPauses.first));
  arguments.SetInt(GRPC_ARG_MIN_RECONNECT_BACKOFF_MS, Milliseconds(kConnectTimeout));
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, Milliseconds(kReconnectPauses.longest));
  // Each caller gets its own channel: two workers in one test process must not share a connection.
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  return grpc::CreateCustomChannel(address, MakeChannelCredentials(security), arguments);
}

}  // namespace lumifold::rpc
