#include "tests/unit/http/raw_caller.h"

#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/time.h>

#include <array>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <utility>

#include "absl/strings/match.h"
#include "server/access/certificate_authority.h"

namespace lumifold::http {
namespace {

SSL_CTX* ClientContext() {
  static SSL_CTX* const context = SSL_CTX_new(TLS_client_method());
  return context;
}

}  // namespace

RawCaller::RawCaller() : socket_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
  const timeval patience = {.tv_sec = 20, .tv_usec = 0};
  setsockopt(socket_.get(), SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  setsockopt(socket_.get(), SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience);
}

void RawCaller::Connect(int port) {
  sockaddr_in address = {};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  EXPECT_EQ(connect(socket_.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
}

bool RawCaller::StartTls(int highest) {
  signal(SIGPIPE, SIG_IGN);  // OpenSSL writes to closed sockets with it
  tls_.reset(SSL_new(ClientContext()));
  SSL_set_security_level(tls_.get(), 0);
  SSL_set_max_proto_version(tls_.get(), highest);
  SSL_set_fd(tls_.get(), socket_.get());
  return SSL_connect(tls_.get()) == 1;
}

bool RawCaller::Send(absl::string_view bytes) {
  if (tls_ != nullptr)
    return SSL_write(tls_.get(), bytes.data(), static_cast<int>(bytes.size())) ==
           static_cast<int>(bytes.size());
  return send(socket_.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(bytes.size());
}

void RawCaller::EndSending() {
  if (tls_ != nullptr) SSL_shutdown(tls_.get());
  shutdown(socket_.get(), SHUT_WR);
}

std::string RawCaller::ReadTo(absl::string_view end) {
  std::string all;
  std::array<char, 65536> bytes;
  while (!absl::StrContains(all, end)) {
    const ssize_t got = tls_ != nullptr ? SSL_read(tls_.get(), bytes.data(), static_cast<int>(bytes.size()))
                                        : recv(socket_.get(), bytes.data(), bytes.size(), 0);
    if (got < 0 && errno == EAGAIN) return all + "timeout";
    if (got <= 0) break;
    all.append(bytes.data(), static_cast<size_t>(got));
  }
  return all;
}

std::string RawCaller::Certificate() const {
  const std::unique_ptr<X509, decltype(&X509_free)> certificate(SSL_get1_peer_certificate(tls_.get()),
                                                                X509_free);
  std::array<unsigned char, 32> digest = {};
  X509_digest(certificate.get(), EVP_sha256(), digest.data(), nullptr);
  return {digest.begin(), digest.end()};
}

TestServer::TestServer(ServerOptions options) : uses_tls(!options.certificate_path.empty()) {
  listening = *sockets::ListenAt("127.0.0.1:0");
  options.listening = &listening.sockets;
  absl::StatusOr<std::unique_ptr<Server>> started = Server::Start(std::move(options));
  EXPECT_TRUE(started.ok()) << started.status();
  if (started.ok()) server = *std::move(started);
}

RawCaller TestServer::Caller() const {
  RawCaller caller(listening.port);
  const bool is_connected = !uses_tls || caller.StartTls();
  EXPECT_TRUE(is_connected);
  return caller;
}

std::string TestServer::Ask(absl::string_view request) const {
  RawCaller caller = Caller();
  caller.Send(request);
  return caller.ReadAll();
}

std::string WriteCertificate(const TempFolder& folder) {
  const absl::Time now = absl::FromUnixSeconds(1'700'000'000);
  const std::string path = folder.PathOf("server.pem");
  EXPECT_TRUE(access::CertificateAuthority::Create(folder.path(), now).ok());
  const auto authority = access::CertificateAuthority::Open(folder.path());
  EXPECT_TRUE(authority.ok());
  std::ofstream(path + ".new") << *(*authority)->SignServer({"127.0.0.1"}, now, absl::Hours(24));
  std::filesystem::rename(path + ".new", path);
  return path;
}

}  // namespace lumifold::http
