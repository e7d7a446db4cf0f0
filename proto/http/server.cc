#include "proto/http/server.h"

#include <fcntl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <boost/asio/post.hpp>
#include <cerrno>
#include <exception>
#include <list>
#include <thread>
#include <tuple>
#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/http/certificate_file.h"
#include "proto/http/connection.h"

namespace lumifold::http {
namespace {

namespace net = boost::asio;
using boost::system::error_code;

/// Before the next try to accept while there are too many connections or no descriptor is left.
constexpr absl::Duration kFullPause = absl::Milliseconds(50);

bool IsShortage(int error) {
  return error == EMFILE || error == ENFILE || error == ENOBUFS || error == ENOMEM;
}

struct Listener {
  explicit Listener(net::io_context& io) : socket(io), pause(io) {}
  net::posix::stream_descriptor socket;
  net::steady_timer pause;
};

class ServerImpl final : public Server {
 public:
  explicit ServerImpl(ServerOptions options)
      : shared_{.options = std::move(options)}, certificate_(shared_.options.certificate_path) {}
  ~ServerImpl() override { ServerImpl::Stop(); }

  absl::Status Open();
  void Stop() override;

 private:
  bool UsesTls() const { return !shared_.options.certificate_path.empty(); }
  void Run();
  /// Waits for a connection, and accepts it.
  void Watch(Listener& listener);
  void WatchLater(Listener& listener);
  void Accept(Listener& listener);
  void Serve(int socket);
  void StopAll();

  Shared shared_;
  CertificateFile certificate_;
  std::list<Listener> listeners_;
  std::optional<net::executor_work_guard<net::io_context::executor_type>> work_;
  std::thread thread_;
};

absl::Status ServerImpl::Open() {
  if (UsesTls() && certificate_.Read() == nullptr)
    return absl::UnavailableError(
        absl::StrCat("cannot use the certificate ", shared_.options.certificate_path));
  for (const rpc::FileHandle& listening : *shared_.options.listening) {
    const int copy = fcntl(listening.get(), F_DUPFD_CLOEXEC, 0);
    if (copy < 0) return absl::UnavailableError("no descriptor is left");
    error_code error;
    if (listeners_.emplace_back(shared_.io).socket.assign(copy, error); error) {
      close(copy);
      return absl::UnavailableError(error.message());
    }
    Watch(listeners_.back());
  }
  work_.emplace(shared_.io.get_executor());
  thread_ = std::thread([this] { Run(); });
  return absl::OkStatus();
}

void ServerImpl::Run() {
  while (true) {
    try {
      shared_.io.run();
      return;
    } catch (const std::exception&) {
      continue;  // no memory for one connection: it is over, as what it waited for has ended
    }
  }
}

void ServerImpl::Watch(Listener& listener) {
  listener.socket.async_wait(net::posix::stream_descriptor::wait_read, [this, &listener](error_code error) {
    if (!error) Accept(listener);
  });
}

void ServerImpl::WatchLater(Listener& listener) {
  listener.pause.expires_after(absl::ToChronoNanoseconds(kFullPause));
  listener.pause.async_wait([this, &listener](error_code error) {
    if (!error && !shared_.is_stopping) Watch(listener);
  });
}

void ServerImpl::Accept(Listener& listener) {
  if (shared_.is_stopping) return;
  const Limits& limits = shared_.options.limits;
  if (shared_.connections.size() >= limits.connections) {
    for (Connection* connection : shared_.connections) connection->CloseIfWaiting(limits.patience);
    return WatchLater(listener);
  }
  const int socket = accept4(listener.socket.native_handle(), nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
  if (socket >= 0) {
    Serve(socket);
  } else if (IsShortage(errno)) {
    return WatchLater(listener);
  }
  Watch(listener);
}

void ServerImpl::Serve(int socket) {
  net::ip::tcp::socket accepted(shared_.io);
  error_code error;
  if (accepted.assign(net::ip::tcp::v4(), socket, error); error) {
    close(socket);
    return;
  }
  std::ignore = accepted.set_option(net::ip::tcp::no_delay(true), error);
  try {
    std::make_shared<Connection>(&shared_, std::move(accepted), UsesTls() ? certificate_.Read() : nullptr)
        ->Start();
  } catch (const std::exception&) {
    return;  // no memory for this connection, which is closed
  }
}

void ServerImpl::StopAll() {
  shared_.is_stopping = true;
  work_.reset();
  error_code ignored;
  for (Listener& listener : listeners_) {
    std::ignore = listener.socket.close(ignored);
    listener.pause.cancel();
  }
  for (Connection* connection : shared_.connections) connection->Stop();
}

void ServerImpl::Stop() {
  if (!thread_.joinable()) return;
  net::post(shared_.io, [this] { StopAll(); });
  thread_.join();
}

}  // namespace

absl::StatusOr<std::unique_ptr<Server>> Server::Start(ServerOptions options) {
  try {
    auto server = std::make_unique<ServerImpl>(std::move(options));
    if (absl::Status status = server->Open(); !status.ok()) return status;
    return server;
  } catch (const std::exception& error) {
    return absl::UnavailableError(absl::StrCat("cannot serve HTTP: ", error.what()));
  }
}

}  // namespace lumifold::http
