#include "proto/logging/nonblocking_log.h"

#include <poll.h>
#include <spdlog/logger.h>
#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/base_sink.h>
#include <unistd.h>

#include <limits.h>
#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <mutex>
#include <string_view>

#include "absl/time/time.h"
#include "proto/logging/json_formatter.h"
#include "proto/logging/line_writer.h"

namespace lumifold::logging {
namespace {

constexpr absl::Duration kFlushTime = absl::Milliseconds(500);
constexpr int kPollMs = 100;
/// The end of a line that is too long.
constexpr std::string_view kCut = "... (cut)\n";

/// Writes once the file takes bytes. A pipe that poll calls writable takes PIPE_BUF bytes at once, so a write
/// of no more does not block, unless another process fills the pipe in between. False for a broken file.
bool WriteWhenReady(int file, std::string_view bytes) {
  while (!bytes.empty()) {
    pollfd waiting = {.fd = file, .events = POLLOUT, .revents = 0};
    const int ready = poll(&waiting, 1, kPollMs);
    if (ready == 0 || (ready < 0 && errno == EINTR)) continue;
    if (ready < 0) return false;
    const ssize_t n = write(file, bytes.data(), std::min<size_t>(bytes.size(), PIPE_BUF));
    if (n < 0 && (errno == EINTR || errno == EAGAIN)) continue;
    if (n < 0) return false;
    bytes.remove_prefix(static_cast<size_t>(n));
  }
  return true;
}

std::unique_ptr<spdlog::formatter> MakeFormatter(const LogOptions& options) {
  if (options.format == "json") return std::make_unique<JsonFormatter>(kMaxLogLineBytes);
  return std::make_unique<spdlog::pattern_formatter>(options.pattern);
}

/// The file of a log, and lines about dropped lines.
class LogFile final : public LineWriter::File {
 public:
  explicit LogFile(const LogOptions& options)
      : name_(options.name), file_(options.file), formatter_(MakeFormatter(options)) {}

  void Write(std::string_view lines, uint64_t dropped) override {
    is_open_ = is_open_ && WriteWhenReady(file_, lines);
    if (dropped > 0) is_open_ = is_open_ && WriteWhenReady(file_, DroppedLine(dropped));
  }

 private:
  std::string DroppedLine(uint64_t dropped) const {
    const std::string text = "event=log_dropped lines=" + std::to_string(dropped);
    spdlog::memory_buf_t line;
    formatter_->format(spdlog::details::log_msg(name_, spdlog::level::warn, text), line);
    return {line.data(), line.size()};
  }

  const std::string name_;
  const int file_;
  const std::unique_ptr<spdlog::formatter> formatter_;
  bool is_open_ = true;
};

class NonblockingSink final : public spdlog::sinks::base_sink<std::mutex> {
 public:
  explicit NonblockingSink(const LogOptions& options)
      : writer_({.max_waiting_bytes = options.max_waiting_bytes, .flush_time = kFlushTime},
                std::make_unique<LogFile>(options)) {}

 private:
  void sink_it_(const spdlog::details::log_msg& message) override {
    spdlog::memory_buf_t line;
    formatter_->format(message, line);
    if (line.size() > kMaxLogLineBytes) {
      line.resize(kMaxLogLineBytes - kCut.size());
      line.append(kCut);
    }
    writer_.Add({line.data(), line.size()});
  }
  void flush_() override {}

  LineWriter writer_;
};

}  // namespace

std::shared_ptr<spdlog::logger> MakeNonblockingLogger(const LogOptions& options) {
  auto log = std::make_shared<spdlog::logger>(options.name, std::make_shared<NonblockingSink>(options));
  log->set_formatter(MakeFormatter(options));
  log->set_level(spdlog::level::from_str(options.level));
  return log;
}

}  // namespace lumifold::logging
