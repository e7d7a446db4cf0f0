#include "proto/logging/nonblocking_log.h"

#include <poll.h>
#include <spdlog/logger.h>
#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/base_sink.h>
#include <unistd.h>

#include <limits.h>
#include <algorithm>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <string_view>
#include <thread>
#include <utility>

#include "proto/logging/json_formatter.h"

namespace lumifold::logging {
namespace {

constexpr auto kFlushTime = std::chrono::milliseconds(500);
constexpr int kPollMs = 100;
/// The end of a line that is too long.
constexpr std::string_view kCut = "... (cut)\n";

/// What the sink and its thread share. The thread may outlive the sink: a write that blocks cannot be ended.
struct Queue {
  std::mutex mutex;
  std::condition_variable changed;
  std::string lines;   // guarded by mutex, like all below
  size_t dropped = 0;  // since the last batch
  bool stopping = false;
  bool idle = true;  // the thread has written everything
};

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

/// The line about dropped lines.
std::string DroppedLine(const std::string& name, spdlog::formatter& formatter, size_t dropped) {
  const std::string text = "event=log_dropped lines=" + std::to_string(dropped);
  spdlog::memory_buf_t line;
  formatter.format(spdlog::details::log_msg(name, spdlog::level::warn, text), line);
  return {line.data(), line.size()};
}

std::unique_ptr<spdlog::formatter> MakeFormatter(const LogOptions& options) {
  if (options.format == "json") return std::make_unique<JsonFormatter>(kMaxLogLineBytes);
  return std::make_unique<spdlog::pattern_formatter>(options.pattern);
}

void WriteLines(const std::shared_ptr<Queue>& queue, const LogOptions& options) {
  const std::unique_ptr<spdlog::formatter> formatter = MakeFormatter(options);
  bool is_open = true;
  std::unique_lock lock(queue->mutex);
  while (true) {
    queue->idle = queue->lines.empty() && queue->dropped == 0;
    if (queue->idle) queue->changed.notify_all();
    if (queue->idle && queue->stopping) return;
    queue->changed.wait(lock, [&] { return queue->stopping || !queue->lines.empty() || queue->dropped > 0; });
    std::string batch = std::exchange(queue->lines, {});
    // Lines are dropped only while others wait, so the dropped ones come after the batch.
    const size_t dropped = std::exchange(queue->dropped, 0);
    lock.unlock();
    if (dropped > 0) batch += DroppedLine(options.name, *formatter, dropped);
    is_open = is_open && WriteWhenReady(options.file, batch);
    lock.lock();
  }
}

class NonblockingSink final : public spdlog::sinks::base_sink<std::mutex> {
 public:
  explicit NonblockingSink(const LogOptions& options)
      : max_waiting_bytes_(options.max_waiting_bytes), queue_(std::make_shared<Queue>()) {
    std::thread([queue = queue_, options] { WriteLines(queue, options); }).detach();
  }

  ~NonblockingSink() override {
    std::unique_lock lock(queue_->mutex);
    queue_->stopping = true;
    queue_->changed.notify_all();
    queue_->changed.wait_until(lock, std::chrono::steady_clock::now() + kFlushTime,
                               [this] { return queue_->idle; });
  }

 private:
  void sink_it_(const spdlog::details::log_msg& message) override {
    spdlog::memory_buf_t line;
    formatter_->format(message, line);
    if (line.size() > kMaxLogLineBytes) {
      line.resize(kMaxLogLineBytes - kCut.size());
      line.append(kCut);
    }
    const std::lock_guard lock(queue_->mutex);
    if (queue_->dropped > 0 || queue_->lines.size() + line.size() > max_waiting_bytes_) {
      ++queue_->dropped;
      return;
    }
    queue_->lines.append(line.data(), line.size());
    queue_->idle = false;
    queue_->changed.notify_all();
  }
  void flush_() override {}

  const size_t max_waiting_bytes_;
  const std::shared_ptr<Queue> queue_;
};

}  // namespace

std::shared_ptr<spdlog::logger> MakeNonblockingLogger(const LogOptions& options) {
  auto log = std::make_shared<spdlog::logger>(options.name, std::make_shared<NonblockingSink>(options));
  log->set_formatter(MakeFormatter(options));
  log->set_level(spdlog::level::from_str(options.level));
  return log;
}

}  // namespace lumifold::logging
