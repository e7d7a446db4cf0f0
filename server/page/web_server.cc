#include "server/page/web_server.h"

#include <fcntl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <functional>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"
#include "proto/rpc/credentials.h"
#include "proto/rpc/monotonic.h"
#include "server/page/connection.h"

namespace lumifold::page {
namespace {

/// From the first byte of a request to its last.
constexpr absl::Duration kRequestTime = absl::Seconds(10);
/// Between two requests of a connection.
constexpr absl::Duration kIdleTime = absl::Seconds(30);
/// Bytes of a request's body: JSON of a call.
constexpr size_t kMaxBodyBytes = 64 << 10;
/// How soon connections without a request see that the server stops.
constexpr absl::Duration kStopTime = absl::Milliseconds(100);
/// Of the thread that accepts: there are too many connections, so that the next one is closed instead of being served.
thread_local bool is_refused = false;

}  // namespace

/// A thread for each connection, up to a number.
class WebServer::Threads final : public httplib::TaskQueue {
 public:
  explicit Threads(int most) : most_(most) {}

  void enqueue(std::function<void()> serve) override {
    {
      absl::MutexLock lock(&mutex_);
      if (running_ < most_) {
        ++running_;
        std::thread([this, serve = std::move(serve)] {
          serve();
          absl::MutexLock done(&mutex_);
          --running_;
        }).detach();
        return;
      }
    }
    is_refused = true;
    serve();
    is_refused = false;
  }
  void shutdown() override {
    absl::MutexLock lock(&mutex_);
    mutex_.Await(absl::Condition(this, &Threads::IsIdle));
  }

 private:
  bool IsIdle() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return running_ == 0; }

  const int most_;
  absl::Mutex mutex_;
  int running_ ABSL_GUARDED_BY(mutex_) = 0;
};

absl::Status WebServer::Start() {
  rpc::HostAndPort where;
  if (absl::Status status = rpc::ParseHostAndPort(options_.address, &where); !status.ok()) return status;
  if (uses_tls() && MakeContext() == nullptr)
    return absl::UnavailableError(absl::StrCat("cannot use the certificate ", options_.certificate_path));
  new_task_queue = [this] { return new Threads(options_.connections); };
  set_payload_max_length(kMaxBodyBytes);
  set_tcp_nodelay(true);
  port_ = where.port == 0 ? bind_to_any_port(where.host) : where.port;
  if (port_ <= 0 || (where.port != 0 && !bind_to_port(where.host, where.port)))
    return absl::UnavailableError(absl::StrCat("cannot show the status page at ", options_.address));
  thread_ = std::thread([this] { listen_after_bind(); });
  return absl::OkStatus();
}

void WebServer::Stop() {
  if (!thread_.joinable()) return;
  // A stop before the loop runs would not be seen.
  while (!is_running()) std::this_thread::yield();
  stop_.Notify();
  stop();
  thread_.join();
}

std::unique_ptr<SSL_CTX, FreeSslContext> WebServer::MakeContext() const {
  std::unique_ptr<SSL_CTX, FreeSslContext> context(SSL_CTX_new(TLS_server_method()));
  const char* const file = options_.certificate_path.c_str();
  const bool is_usable = context != nullptr &&
                         SSL_CTX_set_min_proto_version(context.get(), TLS1_2_VERSION) == 1 &&
                         SSL_CTX_use_certificate_chain_file(context.get(), file) == 1 &&
                         SSL_CTX_use_PrivateKey_file(context.get(), file, SSL_FILETYPE_PEM) == 1;
  return is_usable ? std::move(context) : nullptr;
}

bool WebServer::Serve(socket_t socket) {
  std::unique_ptr<SSL_CTX, FreeSslContext> context;
  if (uses_tls()) {
    context = MakeContext();
    if (context == nullptr) return false;
  }
  Connection connection(socket, context == nullptr ? nullptr : SSL_new(context.get()));
  connection.SetReadDeadline(rpc::MonotonicNow() + kRequestTime);
  if (!connection.Accept()) return false;
  bool closed = false;
  absl::Time idle = rpc::MonotonicNow();
  while (!closed && !stop_.HasBeenNotified() && rpc::MonotonicNow() - idle < kIdleTime) {
    if (!connection.WaitForRequest(rpc::MonotonicNow() + kStopTime)) continue;
    connection.SetReadDeadline(rpc::MonotonicNow() + kRequestTime);
    if (!process_request(connection, /*close_connection=*/false, closed, nullptr)) return false;
    idle = rpc::MonotonicNow();
  }
  return true;
}

bool WebServer::process_and_close_socket(socket_t socket) {
  fcntl(socket, F_SETFD, FD_CLOEXEC);
  fcntl(socket, F_SETFL, O_NONBLOCK);
  const bool served = !is_refused && Serve(socket);
  shutdown(socket, SHUT_RDWR);
  close(socket);
  return served;
}

}  // namespace lumifold::page
