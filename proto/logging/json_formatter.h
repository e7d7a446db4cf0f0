#pragma once

#include <spdlog/formatter.h>

#include <chrono>
#include <cstddef>
#include <memory>
#include <string>
#include <string_view>

namespace lumifold::logging {

/// One line of the log as a JSON object, with its end: time (RFC 3339, UTC, microseconds), level, event, the
/// fields in their order, and msg, the free text, where there is any. All values are strings, exactly as they
/// were logged: a number of one event is text of another, and programs that index logs take one type a name.
/// Bytes that are no UTF-8 become U+FFFD. A name that repeats, or is one of those above, gets a number:
/// error_2. Of a line over `max_bytes` (at least 1024, with the end) values are cut, then fields left out; it
/// then has "cut": "true".
std::string JsonLine(std::chrono::system_clock::time_point time, std::string_view level,
                     std::string_view line, size_t max_bytes);

/// "debug", "info", "warn" or "error".
std::string_view LevelName(spdlog::level::level_enum level);

/// JsonLine for spdlog.
class JsonFormatter final : public spdlog::formatter {
 public:
  explicit JsonFormatter(size_t max_bytes) : max_bytes_(max_bytes) {}
  void format(const spdlog::details::log_msg& message, spdlog::memory_buf_t& out) override;
  std::unique_ptr<spdlog::formatter> clone() const override;

 private:
  const size_t max_bytes_;
};

}  // namespace lumifold::logging
