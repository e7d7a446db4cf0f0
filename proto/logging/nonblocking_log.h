#pragma once

#include <cstddef>
#include <memory>
#include <string>

namespace spdlog {
class logger;
}  // namespace spdlog

namespace lumifold::logging {

/// Bytes of log lines that wait for a reader of standard error; about ten thousand lines. Further lines are
/// dropped and counted.
inline constexpr size_t kMaxWaitingLogBytes = size_t{1} << 20;
/// Bytes of one line; the rest is cut.
inline constexpr size_t kMaxLogLineBytes = size_t{16} << 10;

struct LogOptions {
  std::string name;
  /// "text", in the pattern of spdlog, or "json", see JsonLine.
  std::string format = "text";
  std::string pattern = "%+";
  /// "debug", "info", "warn", "error" or "off".
  std::string level = "info";
  /// Standard error.
  int file = 2;
  size_t max_waiting_bytes = kMaxWaitingLogBytes;
};

/// A logger whose calls never wait for the reader of its file, which may be a full pipe or a stopped
/// terminal. A thread of its own writes. Lines over the limit are dropped; when the file takes lines again,
/// one line "event=log_dropped lines=N" tells how many. At its end it gives the file half a second to take
/// the rest.
/// Threads: safe.
std::shared_ptr<spdlog::logger> MakeNonblockingLogger(const LogOptions& options);

}  // namespace lumifold::logging
