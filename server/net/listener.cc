#include "server/net/listener.h"

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <spdlog/logger.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <list>
#include <map>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "absl/synchronization/mutex.h"
#include "proto/logging/fields.h"
#include "proto/rpc/byte_stream.h"
#include "proto/sockets/listening_sockets.h"
#include "server/access/rate_limit.h"
#include "server/net/address_filter.h"
#include "server/net/connection_table.h"
#include "server/net/unserved_connections.h"

namespace lumifold::server {
namespace {

/// Lines about refused connections in a second; the last one says how many had none.
constexpr int kMaxLinesPerSecond = 10;
/// Pause while the process has no descriptor for another connection.
constexpr int kNoDescriptorPauseMs = 100;
constexpr int kTickMs = 500;
constexpr absl::string_view kHttp2 = "PRI";
constexpr absl::string_view kTls = "\x16\x03";

/// Writes the lines about refused connections, at most kMaxLinesPerSecond.
class RefusalLines {
 public:
  void Write(absl::Time now, const std::string& network, absl::string_view reason, spdlog::logger* log) {
    if (now - second_ >= absl::Seconds(1)) {
      if (without_line_ > 0) log->warn("event=connections_refused connections={}", without_line_);
      second_ = now;
      lines_ = 0;
      without_line_ = 0;
    }
    if (lines_ >= kMaxLinesPerSecond) {
      ++without_line_;
      return;
    }
    ++lines_;
    log->warn("event=connection_refused address={} reason={}", network, logging::Quoted(reason));
  }

 private:
  absl::Time second_ = absl::InfinitePast();
  int lines_ = 0;
  int without_line_ = 0;
};

class ListenerImpl final : public Listener {
 public:
  explicit ListenerImpl(const ListenerOptions& options)
      : options_(options),
        table_(options.connections_per_address, options.connections),
        refusals_(options.refusals_per_second, options.refusal_burst) {}
  ~ListenerImpl() override { Stop(); }

  absl::Status Listen();
  int port() const override { return port_; }
  void Start(std::function<void(int)> take) override {
    take_ = std::move(take);
    thread_ = std::thread([this] { Run(); });
  }
  void Stop() override {
    if (!thread_.joinable()) return;
    {
      absl::MutexLock lock(&orders_.mutex);
      orders_.stop = true;
    }
    eventfd_write(descriptors_.wake.get(), 1);
    thread_.join();
  }
  void ShutOut(absl::string_view name) override {
    const std::optional<Peer> peer = PeerOf(name);
    if (!peer.has_value()) return;
    absl::MutexLock lock(&orders_.mutex);
    if (orders_.stop) return;
    orders_.to_shut_out.push_back(*peer);
    eventfd_write(descriptors_.wake.get(), 1);
  }

  void NoteCall(absl::string_view name) override {
    if (const std::optional<Peer> peer = PeerOf(name)) unserved_.NoteCall(*peer);
  }

 private:
  /// A connection without bytes.
  struct Silent {
    int socket;
    Peer peer;
    absl::Time deadline;
  };
  using Silents = std::list<Silent>;  // in the order of their deadlines
  struct Descriptors {
    std::vector<rpc::FileHandle> listening;
    rpc::FileHandle poll;
    rpc::FileHandle wake;
  };
  /// What other threads ask for.
  struct Orders {
    absl::Mutex mutex;
    bool stop ABSL_GUARDED_BY(mutex) = false;
    std::vector<Peer> to_shut_out ABSL_GUARDED_BY(mutex);
  };

  void Watch(int descriptor) {
    epoll_event event = {.events = EPOLLIN | EPOLLRDHUP, .data = {.fd = descriptor}};
    epoll_ctl(descriptors_.poll.get(), EPOLL_CTL_ADD, descriptor, &event);
  }
  void Run();
  /// Does what other threads asked for. False: to stop.
  bool TakeOrders();
  void CloseAndShutOut(const Peer& peer);
  void ShutOutNetwork(const std::string& network);
  void Readmit();
  void UpdateFilter();
  bool IsShutOut(const std::string& network);
  void Accept(int listening);
  void OnBytes(Silents::iterator silent);
  /// Stops watching the connection; the caller decides what becomes of its socket.
  Silent Take(Silents::iterator silent);
  void Refuse(int socket, const std::string& network, absl::string_view reason);
  void CountRefusal(const std::string& network);
  void CloseSilent();
  void CountEnded();

  const ListenerOptions options_;
  int port_ = 0;
  Descriptors descriptors_;
  std::function<void(int)> take_;
  // Used by the thread only.
  ConnectionTable table_;
  access::TokenBuckets refusals_;
  absl::Time next_count_ = absl::InfinitePast();
  Silents silents_;
  std::map<int, Silents::iterator> silent_by_socket_;
  std::map<std::string, absl::Time> shut_out_;  // networks, and until when
  RefusalLines lines_;
  UnservedConnections unserved_;
  Orders orders_;
  std::thread thread_;
};

absl::Status ListenerImpl::Listen() {
  descriptors_.poll = rpc::FileHandle(epoll_create1(EPOLL_CLOEXEC));
  descriptors_.wake = rpc::FileHandle(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
  if (descriptors_.poll.get() < 0 || descriptors_.wake.get() < 0)
    return absl::UnavailableError("no descriptor is left");
  Watch(descriptors_.wake.get());
  absl::StatusOr<sockets::ListeningSockets> listening = sockets::ListenAt(options_.address);
  if (!listening.ok()) return listening.status();
  port_ = listening->port;
  descriptors_.listening = std::move(listening->sockets);
  for (const rpc::FileHandle& socket : descriptors_.listening) Watch(socket.get());
  return absl::OkStatus();
}

void ListenerImpl::Run() {
  std::array<epoll_event, 64> events;
  while (true) {
    const int ready =
        epoll_wait(descriptors_.poll.get(), events.data(), static_cast<int>(events.size()), kTickMs);
    for (int i = 0; i < ready; ++i) {
      const int descriptor = events[static_cast<size_t>(i)].data.fd;
      if (descriptor == descriptors_.wake.get()) {
        if (TakeOrders()) continue;
        descriptors_.listening.clear();
        while (!silents_.empty()) close(Take(silents_.begin()).socket);
        return;
      }
      const auto silent = silent_by_socket_.find(descriptor);
      if (silent != silent_by_socket_.end()) {
        OnBytes(silent->second);
      } else {
        Accept(descriptor);
      }
    }
    CloseSilent();
    CountEnded();
    Readmit();
  }
}

bool ListenerImpl::TakeOrders() {
  eventfd_t ignored = 0;
  eventfd_read(descriptors_.wake.get(), &ignored);
  std::vector<Peer> peers;
  {
    absl::MutexLock lock(&orders_.mutex);
    if (orders_.stop) return false;
    peers.swap(orders_.to_shut_out);
  }
  for (const Peer& peer : peers) CloseAndShutOut(peer);
  return true;
}

void ListenerImpl::CloseAndShutOut(const Peer& peer) {
  ShutOutNetwork(peer.network);
  // Its owner may close it in this moment, and the number may be another connection's: that one would be
  // opened again.
  if (const std::optional<int> socket = table_.Find(peer)) shutdown(*socket, SHUT_RDWR);
}

void ListenerImpl::ShutOutNetwork(const std::string& network) {
  if (!shut_out_.insert_or_assign(network, options_.now() + options_.shut_out).second) return;
  options_.log->warn("event=address_shut_out address={} seconds={} reason=\"it was refused too often\"",
                     network, absl::ToInt64Seconds(options_.shut_out));
  UpdateFilter();
}

void ListenerImpl::Readmit() {
  const absl::Time now = options_.now();
  if (std::erase_if(shut_out_, [now](const auto& entry) { return entry.second <= now; }) > 0) UpdateFilter();
}

void ListenerImpl::UpdateFilter() {
  std::vector<std::string> networks;
  for (const auto& [network, until] : shut_out_) networks.push_back(network);
  for (const rpc::FileHandle& listening : descriptors_.listening) FilterAddresses(listening.get(), networks);
}
bool ListenerImpl::IsShutOut(const std::string& network) {
  const auto found = shut_out_.find(network);
  return found != shut_out_.end() && options_.now() < found->second;
}

void ListenerImpl::Accept(int listening) {
  sockaddr_storage address = {};
  socklen_t size = sizeof address;
  const int socket =
      accept4(listening, reinterpret_cast<sockaddr*>(&address), &size, SOCK_NONBLOCK | SOCK_CLOEXEC);
  if (socket < 0) {
    // The connection waits in the kernel; without a pause this loop would take a whole core.
    if (errno == EMFILE || errno == ENFILE) usleep(kNoDescriptorPauseMs * 1000);
    return;
  }
  const Peer peer = PeerOf(address);
  if (IsShutOut(peer.network)) return Refuse(socket, peer.network, "the address is shut out");
  if (!table_.Add(socket, peer)) {
    return Refuse(socket, peer.network,
                  absl::StrCat("too many connections: the limits are ", options_.connections_per_address,
                               " of an address and ", options_.connections, " of all"));
  }
  RemoveAddressFilter(socket);
  const int on = 1;
  setsockopt(socket, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  silents_.push_back({socket, peer, options_.now() + options_.first_bytes});
  silent_by_socket_[socket] = std::prev(silents_.end());
  Watch(socket);
}

ListenerImpl::Silent ListenerImpl::Take(Silents::iterator silent) {
  Silent taken = std::move(*silent);
  silent_by_socket_.erase(taken.socket);
  silents_.erase(silent);
  epoll_ctl(descriptors_.poll.get(), EPOLL_CTL_DEL, taken.socket, nullptr);
  return taken;
}

void ListenerImpl::OnBytes(Silents::iterator silent) {
  const absl::string_view expected = options_.expects_tls ? kTls : kHttp2;
  std::array<char, 4> bytes = {};
  const ssize_t count = recv(silent->socket, bytes.data(), expected.size(), MSG_PEEK);
  if (count < 0 && (errno == EAGAIN || errno == EINTR)) return;
  const absl::string_view begin(bytes.data(), count > 0 ? static_cast<size_t>(count) : 0);
  const bool fits = count > 0 && expected.substr(0, begin.size()) == begin;
  const Silent taken = Take(silent);
  if (fits) {
    unserved_.Add(taken.socket, taken.peer);
    return take_(taken.socket);  // fewer bytes than expected: the handshake has a time limit of its own
  }
  absl::string_view reason = "not HTTP/2";
  if (count <= 0) {
    reason = "closed by the other side before its first byte";
  } else if (options_.expects_tls) {
    reason = "not TLS, which this port expects";
  } else if (absl::StartsWith(begin, kTls)) {
    reason = "TLS, but this port is in plain text";
  }
  Refuse(taken.socket, taken.peer.network, reason);
}

void ListenerImpl::Refuse(int socket, const std::string& network, absl::string_view reason) {
  const absl::Time now = options_.now();
  CountRefusal(network);
  table_.Remove(socket);
  close(socket);
  lines_.Write(now, network, reason, options_.log.get());
}

void ListenerImpl::CountRefusal(const std::string& network) {
  if (!refusals_.Take(network, options_.now())) ShutOutNetwork(network);
}

void ListenerImpl::CloseSilent() {
  const absl::Time now = options_.now();
  while (!silents_.empty() && silents_.front().deadline <= now) {
    const Silent taken = Take(silents_.begin());
    Refuse(taken.socket, taken.peer.network,
           absl::StrCat("silent for ", absl::FormatDuration(options_.first_bytes)));
  }
}

void ListenerImpl::CountEnded() {
  const absl::Time now = options_.now();
  if (now < next_count_) return;
  next_count_ = now + absl::Milliseconds(kTickMs);
  for (const std::string& network : unserved_.TakeEnded()) CountRefusal(network);
}

}  // namespace

absl::StatusOr<std::unique_ptr<Listener>> Listener::Open(const ListenerOptions& options) {
  auto listener = std::make_unique<ListenerImpl>(options);
  if (absl::Status status = listener->Listen(); !status.ok()) return status;
  return listener;
}

}  // namespace lumifold::server
