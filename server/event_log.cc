#include "server/event_log.h"

#include <spdlog/logger.h>
#include <spdlog/sinks/sink.h>

#include <algorithm>
#include <chrono>
#include <utility>

namespace lumifold::server {
namespace {

/// The value of a field "name=value" or name="value"; empty if the line has no such field. Quoted values are skipped as
/// a whole, so that a text that contains "job=" is no field.
std::string_view FieldOf(std::string_view line, std::string_view name) {
  while (!line.empty()) {
    const size_t equals = line.find('=');
    if (equals == std::string_view::npos) return "";
    const std::string_view key = line.substr(0, equals);
    line.remove_prefix(equals + 1);
    const bool is_quoted = line.starts_with('"');
    if (is_quoted) line.remove_prefix(1);
    size_t end = 0;
    while (end < line.size() && line[end] != (is_quoted ? '"' : ' '))
      end += is_quoted && line[end] == '\\' ? 2 : 1;
    const std::string_view value = line.substr(0, end);
    if (key == name) return value;
    line.remove_prefix(std::min(line.size(), end + (is_quoted ? 2 : 1)));
  }
  return "";
}

std::string_view FirstWord(std::string_view text) { return text.substr(0, text.find(' ')); }

class EventSink final : public spdlog::sinks::sink {
 public:
  EventSink(std::shared_ptr<spdlog::logger> log, EventLog* events) : log_(std::move(log)), events_(events) {}

  void log(const spdlog::details::log_msg& message) override {
    if (log_->should_log(message.level)) {
      for (const spdlog::sink_ptr& target : log_->sinks()) {
        if (target->should_log(message.level)) target->log(message);
      }
    }
    if (message.level < spdlog::level::info) return;
    const auto time = std::chrono::duration_cast<std::chrono::milliseconds>(message.time.time_since_epoch());
    const std::string_view level = message.level == spdlog::level::info   ? "info"
                                   : message.level == spdlog::level::warn ? "warn"
                                                                          : "error";
    events_->Add(time.count(), level, {message.payload.data(), message.payload.size()});
  }
  void flush() override { log_->flush(); }
  void set_pattern(const std::string&) override {}
  void set_formatter(std::unique_ptr<spdlog::formatter>) override {}

 private:
  const std::shared_ptr<spdlog::logger> log_;
  EventLog* const events_;
};

}  // namespace

void EventLog::Add(int64_t unix_ms, std::string_view level, std::string_view line) {
  Event added;
  added.job = FieldOf(line, "job");
  if (added.job.empty()) added.job = FirstWord(FieldOf(line, "unit"));
  const std::string_view worker = FieldOf(line, "worker");
  const size_t slash = std::min(worker.find('/'), worker.size());
  added.worker_id = worker.substr(0, slash);
  if (slash < worker.size()) added.worker_name = worker.substr(slash + 1);
  if (added.job.empty() && added.worker_id.empty()) return;
  added.event.set_unix_ms(unix_ms);
  added.event.set_level(std::string(level));
  added.event.set_text(std::string(line));
  absl::MutexLock lock(&mutex_);
  bytes_ += added.bytes();
  events_.push_back(std::move(added));
  while (events_.size() > max_events_ || bytes_ > max_bytes_) {
    bytes_ -= events_.front().bytes();
    events_.pop_front();
  }
}

template <typename Condition>
std::vector<v1::LogEvent> EventLog::Last(int limit, Condition condition) const {
  std::vector<v1::LogEvent> last;
  absl::MutexLock lock(&mutex_);
  for (auto event = events_.rbegin(); event != events_.rend() && static_cast<int>(last.size()) < limit;
       ++event) {
    if (condition(*event)) last.push_back(event->event);
  }
  std::reverse(last.begin(), last.end());
  return last;
}

std::vector<v1::LogEvent> EventLog::OfJob(const std::string& job_id, int limit) const {
  return Last(limit, [&](const Event& event) { return !job_id.empty() && event.job == job_id; });
}

std::vector<v1::LogEvent> EventLog::OfWorker(const std::string& worker, int limit) const {
  return Last(limit,
              [&](const Event& event) { return event.worker_id == worker || event.worker_name == worker; });
}

std::shared_ptr<spdlog::logger> MakeEventLogger(const std::shared_ptr<spdlog::logger>& log,
                                                EventLog* events) {
  auto logger = std::make_shared<spdlog::logger>(log->name(), std::make_shared<EventSink>(log, events));
  logger->set_level(std::min(log->level(), spdlog::level::info));
  return logger;
}

}  // namespace lumifold::server
