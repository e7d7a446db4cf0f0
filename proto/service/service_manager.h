#pragma once

#include <string>

#include "absl/time/time.h"
#include "proto/rpc/byte_stream.h"

namespace lumifold::service {

/// What a program tells the service manager that has started it, by systemd's protocol sd_notify(3). Where
/// none has, as the environment variable NOTIFY_SOCKET says, nothing is told. The socket is opened once: a
/// program that enters a sandbox afterwards (decision 19) can open no other. That is why it is not
/// libsystemd's sd_notify, which opens one for each message.
/// Threads: one at a time.
class ServiceManager {
 public:
  ServiceManager();

  /// The program does its work from now on. `status`: one line for people.
  void Ready(const std::string& status) const;
  /// It has been told to end, and ends.
  void Stopping() const;

  /// A sign of life, for a manager that ends programs that give none. Call it from the loop whose standing
  /// still means that the program hangs, as often as is convenient: it is sent no more often than needed.
  void Alive();
  /// How often Alive should be called; InfiniteDuration where nobody waits for it.
  absl::Duration alive_interval() const { return alive_interval_; }

 private:
  void Send(const std::string& text) const;

  rpc::FileHandle socket_;
  absl::Duration alive_interval_ = absl::InfiniteDuration();
  absl::Time next_alive_ = absl::InfinitePast();
};

}  // namespace lumifold::service
