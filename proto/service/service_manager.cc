#include "proto/service/service_manager.h"

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "proto/rpc/monotonic.h"

namespace lumifold::service {
namespace {

std::string Variable(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

/// A socket connected to the manager's; of no file where there is none. A name that begins with '@' is an
/// abstract one.
rpc::FileHandle Connect(std::string name) {
  sockaddr_un address = {};
  if (name.empty() || name.size() >= sizeof(address.sun_path)) return {};
  address.sun_family = AF_UNIX;
  if (name.front() == '@') name.front() = '\0';
  std::copy(name.begin(), name.end(), address.sun_path);
  const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + name.size());
  rpc::FileHandle handle(socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (handle.get() < 0 || connect(handle.get(), reinterpret_cast<const sockaddr*>(&address), size) != 0)
    return {};
  return handle;
}

/// How long the manager waits for a sign of life of this process.
absl::Duration Limit() {
  int64_t limit_us = 0;
  int64_t process = 0;
  if (!absl::SimpleAtoi(Variable("WATCHDOG_USEC"), &limit_us) || limit_us <= 0)
    return absl::InfiniteDuration();
  // Of another process, whose environment this one has inherited.
  if (absl::SimpleAtoi(Variable("WATCHDOG_PID"), &process) && process != getpid())
    return absl::InfiniteDuration();
  return absl::Microseconds(limit_us);
}

}  // namespace

ServiceManager::ServiceManager() : socket_(Connect(Variable("NOTIFY_SOCKET"))) {
  // A quarter, so that one sign of life may be late.
  if (socket_.get() >= 0) alive_interval_ = Limit() / 4;
}

/// A message that cannot be sent is no reason to stop working.
void ServiceManager::Send(const std::string& text) const {
  if (socket_.get() >= 0) send(socket_.get(), text.data(), text.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
}

void ServiceManager::Ready(const std::string& status) const {
  Send(absl::StrCat("READY=1\nSTATUS=", absl::StrReplaceAll(status, {{"\n", " "}})));
}

void ServiceManager::Stopping() const { Send("STOPPING=1"); }

void ServiceManager::Alive() {
  if (alive_interval_ == absl::InfiniteDuration()) return;
  const absl::Time now = rpc::MonotonicNow();
  if (now < next_alive_) return;
  next_alive_ = now + alive_interval_;
  Send("WATCHDOG=1");
}

}  // namespace lumifold::service
