#include "proto/monitoring/endpoint.h"

#include <poll.h>
#include <prometheus/collectable.h>
#include <prometheus/text_serializer.h>
#include <sys/eventfd.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <list>
#include <optional>
#include <thread>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "proto/monitoring/http_request.h"
#include "proto/rpc/byte_stream.h"
#include "proto/rpc/credentials.h"
#include "proto/sockets/listening_sockets.h"

namespace lumifold::monitoring {
namespace {

constexpr char kPath[] = "/metrics";
constexpr char kDefaultHost[] = "127.0.0.1";
/// How often connections are looked at whose other end does nothing.
constexpr int kTickMs = 200;
/// Pause while the process has no descriptor for another connection.
constexpr absl::Duration kNoDescriptorPause = absl::Milliseconds(100);

absl::StatusOr<std::string> CompleteAddress(const std::string& address) {
  const bool has_host = absl::StrContains(address, ":") && !absl::StartsWith(address, ":");
  const std::string complete =
      has_host ? address : absl::StrCat(kDefaultHost, absl::StartsWith(address, ":") ? "" : ":", address);
  rpc::HostAndPort parsed;
  if (absl::Status status = rpc::ParseHostAndPort(complete, &parsed); !status.ok()) return status;
  return complete;
}

struct Connection {
  rpc::FileHandle socket;
  absl::Time deadline;
  std::string request = {};
  std::string response = {};  // empty: the request is not complete
  size_t sent = 0;
};

class EndpointImpl final : public Endpoint {
 public:
  explicit EndpointImpl(EndpointOptions options) : options_(std::move(options)) {}
  ~EndpointImpl() override {
    if (!thread_.joinable()) return;
    eventfd_write(wake_.get(), 1);
    thread_.join();
  }
  absl::Status Start();

 private:
  void Run();
  void Accept(int listening);
  /// Does what the socket is ready for. False: the connection is over.
  bool Serve(Connection& connection, int16_t ready);
  bool Receive(Connection& connection);
  static bool Send(Connection& connection);
  const std::string& Text();

  const EndpointOptions options_;
  rpc::FileHandle wake_;
  // Used by the thread only.
  std::list<Connection> connections_;
  absl::Time accepts_from_ = absl::InfinitePast();
  std::string text_;
  absl::Time text_time_ = absl::InfinitePast();
  std::thread thread_;
};

absl::Status EndpointImpl::Start() {
  wake_ = rpc::FileHandle(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
  if (wake_.get() < 0) return absl::UnavailableError("no descriptor is left");
  thread_ = std::thread([this] { Run(); });
  return absl::OkStatus();
}

void EndpointImpl::Run() {
  const std::vector<rpc::FileHandle>& listening = options_.sockets->listening;
  std::vector<pollfd> polled;
  while (true) {
    polled = {{.fd = wake_.get(), .events = POLLIN, .revents = 0}};
    const absl::Time now = options_.now();
    const bool accepts = connections_.size() < options_.connections && now >= accepts_from_;
    for (const rpc::FileHandle& socket : listening)
      polled.push_back({.fd = accepts ? socket.get() : -1, .events = POLLIN, .revents = 0});
    for (const Connection& connection : connections_) {
      const bool sends = connection.sent < connection.response.size();
      polled.push_back({.fd = connection.socket.get(),
                        .events = static_cast<int16_t>(sends ? POLLOUT : POLLIN),
                        .revents = 0});
    }
    poll(polled.data(), polled.size(), kTickMs);
    if (polled[0].revents != 0) return;
    size_t i = 1 + listening.size();
    for (auto it = connections_.begin(); it != connections_.end(); ++i) {
      const bool goes_on = options_.now() < it->deadline && Serve(*it, polled[i].revents);
      it = goes_on ? std::next(it) : connections_.erase(it);
    }
    for (i = 1; i <= listening.size(); ++i) {
      if (polled[i].revents != 0) Accept(polled[i].fd);
    }
  }
}

void EndpointImpl::Accept(int listening) {
  rpc::FileHandle socket(accept4(listening, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC));
  const absl::Time now = options_.now();
  if (socket.get() >= 0) {
    connections_.push_back({.socket = std::move(socket), .deadline = now + options_.connection_time});
  } else if (errno == EMFILE || errno == ENFILE) {
    accepts_from_ = now + kNoDescriptorPause;
  }
}

bool EndpointImpl::Serve(Connection& connection, int16_t ready) {
  if (ready == 0) return true;
  if ((ready & (POLLERR | POLLNVAL)) != 0) return false;
  if (connection.sent < connection.response.size()) return Send(connection);
  return Receive(connection);
}

bool EndpointImpl::Receive(Connection& connection) {
  std::array<char, 2048> bytes;
  const ssize_t count = recv(connection.socket.get(), bytes.data(), bytes.size(), 0);
  if (count < 0) return errno == EAGAIN || errno == EINTR;
  if (count == 0) return false;
  // What comes after the answer is dropped: a socket that is closed with bytes in it would take the answer back.
  if (!connection.response.empty()) return true;
  connection.request.append(bytes.data(), static_cast<size_t>(count));
  std::optional<std::string> response = Answer(connection.request, kPath, [this] { return Text(); });
  if (!response.has_value()) return true;
  connection.response = *std::move(response);
  return Send(connection);
}

bool EndpointImpl::Send(Connection& connection) {
  const ssize_t count = send(connection.socket.get(), connection.response.data() + connection.sent,
                             connection.response.size() - connection.sent, MSG_NOSIGNAL);
  if (count < 0) return errno == EAGAIN || errno == EINTR;
  connection.sent += static_cast<size_t>(count);
  if (connection.sent == connection.response.size()) shutdown(connection.socket.get(), SHUT_WR);
  return true;
}

const std::string& EndpointImpl::Text() {
  const absl::Time now = options_.now();
  if (now < text_time_ + options_.freshness) return text_;
  std::vector<prometheus::MetricFamily> families;
  for (const std::shared_ptr<prometheus::Collectable>& source : options_.sources) {
    std::vector<prometheus::MetricFamily> collected = source->Collect();
    std::move(collected.begin(), collected.end(), std::back_inserter(families));
  }
  text_ = prometheus::TextSerializer().Serialize(families);
  text_time_ = now;
  return text_;
}

}  // namespace

absl::StatusOr<EndpointSockets> ListenForMetrics(const std::string& address) {
  const absl::StatusOr<std::string> complete = CompleteAddress(address);
  if (!complete.ok()) return complete.status();
  absl::StatusOr<sockets::ListeningSockets> listening = sockets::ListenAt(*complete);
  if (!listening.ok()) return listening.status();
  return EndpointSockets{absl::StrCat(complete->substr(0, complete->rfind(':')), ":", listening->port),
                         std::move(listening->sockets)};
}

absl::StatusOr<std::unique_ptr<Endpoint>> Endpoint::Start(EndpointOptions options) {
  auto endpoint = std::make_unique<EndpointImpl>(std::move(options));
  if (absl::Status status = endpoint->Start(); !status.ok()) return status;
  return endpoint;
}

}  // namespace lumifold::monitoring
