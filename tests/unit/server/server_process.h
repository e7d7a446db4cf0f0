#pragma once

#include <sys/types.h>

#include <string>

namespace lumifold::server {

/// The real lumifold-server on a free loopback port. Killed, if need be, when it goes out of scope.
class ServerProcess {
 public:
  /// Starts it over `data_dir` and waits until it listens; its log goes to `log_path`.
  ServerProcess(const std::string& data_dir, const std::string& log_path);
  ~ServerProcess();
  ServerProcess(const ServerProcess&) = delete;
  ServerProcess& operator=(const ServerProcess&) = delete;

  /// 0 where it did not start.
  int port() const { return port_; }

  /// Sends the signal and waits for the end; gives the exit code, or minus the number of the signal it died
  /// of.
  int End(int signal);

 private:
  pid_t pid_ = -1;
  int port_ = 0;
};

}  // namespace lumifold::server
