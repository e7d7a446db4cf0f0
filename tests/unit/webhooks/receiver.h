#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/synchronization/mutex.h"
#include "proto/http/server.h"
#include "proto/sockets/listening_sockets.h"

namespace lumifold::webhooks {

/// An HTTP server of 127.0.0.1 that keeps what it was sent.
class Receiver {
 public:
  using Answer = std::function<http::Response(const http::Request&)>;

  /// `answer`: called by several threads.
  explicit Receiver(Answer answer = [](const http::Request&) { return http::Response{.status = 204}; });
  ~Receiver();

  std::string UrlOf(const std::string& path) const;
  /// HOST:PORT.
  std::string host() const;
  std::vector<http::Request> requests() const;
  /// Waits until it has had so many.
  void Await(size_t requests) const;

 private:
  http::Response Keep(const http::Request& request);

  const Answer answer_;
  mutable absl::Mutex mutex_;
  std::vector<http::Request> requests_ ABSL_GUARDED_BY(mutex_);
  sockets::ListeningSockets listening_;
  std::unique_ptr<http::Server> server_;
};

}  // namespace lumifold::webhooks
