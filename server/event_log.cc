#include "server/event_log.h"

#include <algorithm>
#include <string_view>
#include <utility>

#include "absl/time/time.h"
#include "proto/logging/fields.h"
#include "proto/logging/job_labels.h"

namespace lumifold::server {
void EventLog::Add(const logging::PassedLine& line) {
  Event added;
  added.job = logging::JobOf(line.parsed);
  const std::string_view worker = line.parsed.Get("worker");
  const size_t slash = std::min(worker.find('/'), worker.size());
  added.worker_id = worker.substr(0, slash);
  if (slash < worker.size()) added.worker_name = worker.substr(slash + 1);
  if (added.job.empty() && added.worker_id.empty()) return;
  added.event.set_unix_ms(absl::ToUnixMillis(absl::FromChrono(line.time)));
  added.event.set_level(std::string(line.level));
  added.event.set_text(std::string(line.text));
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
  const auto keep = [events](const logging::PassedLine& line) {
    if (line.level != "debug") events->Add(line);
  };
  return logging::MakeFrontLogger({.log = log, .keep = keep});
}

}  // namespace lumifold::server
