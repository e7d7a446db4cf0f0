#pragma once

#include <sys/types.h>

#include <string>

namespace lumifold::server {

/// A process of lumifold-server on a free loopback port. The destructor kills it if it is running.
class ServerProcess {
 public:
  /// Starts it with `data_dir` and waits until it listens; its log is written to `log_path`.
  ServerProcess(const std::string& data_dir, const std::string& log_path);
  ~ServerProcess();
  ServerProcess(const ServerProcess&) = delete;
  ServerProcess& operator=(const ServerProcess&) = delete;

  /// 0 if it did not start.
  int port() const { return port_; }

  /// Sends the signal and waits for the end; returns the exit code, or minus the number of the signal that
  /// ended it.
  int End(int signal);

 private:
  pid_t pid_ = -1;
  int port_ = 0;
};

}  // namespace lumifold::server
