#include "proto/identity/pinned_ca.h"

#include <netdb.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <memory>
#include <string_view>
#include <system_error>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"
#include "proto/identity/openssl.h"
#include "proto/identity/secrets.h"
#include "proto/rpc/credentials.h"

namespace lumifold::identity {
namespace {

absl::Status Unreachable(const std::string& address, absl::string_view reason) {
  return absl::UnavailableError(absl::StrCat("cannot reach the coordinator at ", address, ": ", reason));
}

/// Connects a socket whose calls, connect(2) included, give up after `timeout`. The caller closes it.
absl::StatusOr<int> Connect(const std::string& address, absl::Duration timeout) {
  rpc::HostAndPort target;
  if (absl::Status status = rpc::ParseHostAndPort(address, &target); !status.ok()) return status;
  addrinfo hints = {};
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  if (const int error = getaddrinfo(target.host.c_str(), absl::StrCat(target.port).c_str(), &hints, &found);
      error != 0)
    return Unreachable(address, gai_strerror(error));
  const absl::Cleanup free_addresses = [found] { freeaddrinfo(found); };
  const timeval limit = absl::ToTimeval(timeout);
  int error = 0;
  for (const addrinfo* entry = found; entry != nullptr; entry = entry->ai_next) {
    const int handle = socket(entry->ai_family, entry->ai_socktype | SOCK_CLOEXEC, entry->ai_protocol);
    if (handle < 0) {
      error = errno;
      continue;
    }
    setsockopt(handle, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof(limit));
    setsockopt(handle, SOL_SOCKET, SO_SNDTIMEO, &limit, sizeof(limit));
    if (connect(handle, entry->ai_addr, entry->ai_addrlen) == 0) return handle;
    error = errno;
    close(handle);
  }
  return Unreachable(address, std::system_category().message(error));
}

/// The certificates that the server at the other end of `handle` sends.
absl::Status Handshake(SSL_CTX* context, int handle, OpensslPtr<SSL>* result) {
  OpensslPtr<SSL> connection(SSL_new(context));
  if (connection == nullptr || SSL_set_fd(connection.get(), handle) != 1)
    return OpensslError("cannot begin a TLS handshake");
  if (SSL_connect(connection.get()) != 1) return OpensslError("no TLS handshake");
  *result = std::move(connection);
  return absl::OkStatus();
}

absl::StatusOr<std::string> FindByHash(const SSL* connection, const std::string& sha256) {
  const STACK_OF(X509)* chain = SSL_get_peer_cert_chain(connection);
  for (int i = 0; i < sk_X509_num(chain); ++i) {
    X509* const certificate = sk_X509_value(chain, i);
    unsigned char* der = nullptr;
    const int size = i2d_X509(certificate, &der);
    if (size <= 0) return OpensslError("cannot encode a certificate");
    const std::string hash = HashOf({reinterpret_cast<const char*>(der), static_cast<size_t>(size)});
    OPENSSL_free(der);
    if (hash != sha256) continue;
    const OpensslPtr<BIO> text(BIO_new(BIO_s_mem()));
    if (text == nullptr || PEM_write_bio_X509(text.get(), certificate) != 1)
      return OpensslError("cannot encode a certificate");
    return TextOf(text.get());
  }
  return absl::UnauthenticatedError("its authority is not that of the code");
}

/// What a client of HTTP/2 sends first: the preface of RFC 9113 and empty settings.
constexpr std::string_view kHttp2Hello("PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\x04\0\0\0\0\0", 33);
/// The type of a frame with settings, which answers it, and where it is in a frame.
constexpr char kSettings = 4;
constexpr size_t kTypeOfFrame = 3;

bool SpeaksHttp2(const std::string& address, absl::Duration timeout) {
  const absl::StatusOr<int> handle = Connect(address, timeout);
  if (!handle.ok()) return false;
  const absl::Cleanup close_handle = [file = *handle] { close(file); };
  std::array<char, kTypeOfFrame + 1> frame{};
  return send(*handle, kHttp2Hello.data(), kHttp2Hello.size(), MSG_NOSIGNAL) ==
             static_cast<ssize_t>(kHttp2Hello.size()) &&
         recv(*handle, frame.data(), frame.size(), MSG_WAITALL) == static_cast<ssize_t>(frame.size()) &&
         frame[kTypeOfFrame] == kSettings;
}

}  // namespace

std::optional<bool> IsEncrypted(const std::string& address, absl::Duration timeout) {
  // It shows its certificates, none of which has this hash.
  if (absl::IsUnauthenticated(FetchPinnedCa(address, /*ca_sha256=*/"", timeout).status())) return true;
  return SpeaksHttp2(address, timeout) ? std::optional<bool>(false) : std::nullopt;
}

absl::StatusOr<std::string> FetchPinnedCa(const std::string& address, const std::string& ca_sha256,
                                          absl::Duration timeout) {
  const OpensslPtr<SSL_CTX> context(SSL_CTX_new(TLS_client_method()));
  // What gRPC asks for: a server may refuse a client that does not name HTTP/2.
  constexpr std::array<unsigned char, 3> kHttp2 = {2, 'h', '2'};
  if (context == nullptr || SSL_CTX_set_min_proto_version(context.get(), TLS1_2_VERSION) != 1 ||
      SSL_CTX_set_alpn_protos(context.get(), kHttp2.data(), kHttp2.size()) != 0)
    return OpensslError("cannot set up TLS");
  SSL_CTX_set_verify(context.get(), SSL_VERIFY_NONE, nullptr);
  const absl::StatusOr<int> handle = Connect(address, timeout);
  if (!handle.ok()) return handle.status();
  const absl::Cleanup close_handle = [file = *handle] { close(file); };
  OpensslPtr<SSL> connection;
  if (absl::Status status = Handshake(context.get(), *handle, &connection); !status.ok())
    return Unreachable(address, status.message());
  absl::StatusOr<std::string> pem = FindByHash(connection.get(), ca_sha256);
  if (absl::IsUnauthenticated(pem.status())) {
    return absl::UnauthenticatedError(absl::StrCat(
        "the server at ", address, " is not the one that the code is for: ", pem.status().message()));
  }
  return pem;
}

}  // namespace lumifold::identity
