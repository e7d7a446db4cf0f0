#include "tests/unit/webhooks/receiver.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/image/check.h"

namespace lumifold::webhooks {

Receiver::Receiver(Answer answer) : answer_(std::move(answer)) {
  listening_ = *sockets::ListenAt("127.0.0.1:0");
  absl::StatusOr<std::unique_ptr<http::Server>> server =
      http::Server::Start({.listening = &listening_.sockets,
                           .handler = [this](const http::Request& request) { return Keep(request); }});
  LUMIFOLD_CHECK(server.ok());
  server_ = *std::move(server);
}

Receiver::~Receiver() { server_->Stop(); }

std::string Receiver::host() const { return absl::StrCat("127.0.0.1:", listening_.port); }

std::string Receiver::UrlOf(const std::string& path) const { return absl::StrCat("http://", host(), path); }

std::vector<http::Request> Receiver::requests() const {
  absl::MutexLock lock(&mutex_);
  return requests_;
}

void Receiver::Await(size_t requests) const {
  absl::MutexLock lock(&mutex_);
  const auto has_come = [&]() ABSL_NO_THREAD_SAFETY_ANALYSIS { return requests_.size() >= requests; };
  mutex_.Await(absl::Condition(&has_come));
}

http::Response Receiver::Keep(const http::Request& request) {
  http::Response response = answer_(request);
  absl::MutexLock lock(&mutex_);
  requests_.push_back(request);
  return response;
}

}  // namespace lumifold::webhooks
