#pragma once

#include <sys/types.h>

#include <cstdio>
#include <memory>
#include <string>

namespace lumifold {

/// A PostgreSQL server for one test program (private_postgres.sh). It ends with the program, also if that is
/// killed.
class PrivatePostgres {
 public:
  /// Starts a server; nullptr, and the reason in `why_not`, where there is none.
  static std::unique_ptr<PrivatePostgres> Start(std::string* why_not);
  ~PrivatePostgres();
  PrivatePostgres(const PrivatePostgres&) = delete;
  PrivatePostgres& operator=(const PrivatePostgres&) = delete;

  /// URI of its database.
  const std::string& uri() const { return uri_; }
  /// Ends the server as by a power cut, and starts it again.
  void StopServer() { Command("stop\n"); }
  void StartServer() { Command("start\n"); }

 private:
  PrivatePostgres(pid_t script, FILE* commands, FILE* answers);
  std::string ReadLine();
  void Command(const char* line);

  const pid_t script_;
  FILE* const commands_;
  FILE* const answers_;
  std::string uri_;
};

}  // namespace lumifold
