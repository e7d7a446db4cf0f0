#include "server/coordinator/event_log.h"

#include <algorithm>
#include <string_view>
#include <utility>

#include "absl/time/time.h"
#include "proto/logging/fields.h"
#include "proto/logging/job_labels.h"
#include "proto/rpc/bounded_text.h"
#include "proto/rpc/limits.h"

namespace lumifold::server {
namespace {

bool IsLevel(std::string_view text) {
  return text == "debug" || text == "info" || text == "warn" || text == "error";
}

}  // namespace
void EventLog::Event::SetWorker(std::string_view worker) {
  const size_t slash = std::min(worker.find('/'), worker.size());
  worker_id = worker.substr(0, slash);
  if (slash < worker.size()) worker_name = worker.substr(slash + 1);
}

void EventLog::Events::Add(Event added, size_t max_events, size_t max_bytes) {
  bytes += added.bytes();
  events.push_back(std::move(added));
  while (events.size() > max_events || bytes > max_bytes) {
    bytes -= events.front().bytes();
    events.pop_front();
  }
}

void EventLog::Add(const logging::PassedLine& line) {
  Event added;
  added.job = logging::JobOf(line.parsed);
  added.SetWorker(line.parsed.Get("worker"));
  if (added.job.empty() && added.worker_id.empty()) return;
  added.event.set_unix_ms(absl::ToUnixMillis(absl::FromChrono(line.time)));
  added.event.set_level(std::string(line.level));
  added.event.set_text(std::string(line.text));
  absl::MutexLock lock(&mutex_);
  events_.Add(std::move(added), max_events_, max_bytes_);
}

void EventLog::AddOfWorker(const std::string& worker,
                           const google::protobuf::RepeatedPtrField<v1::LogEvent>& lines, absl::Time now,
                           absl::FunctionRef<bool(const std::string& job)> is_known) {
  std::vector<Event> added;
  for (int i = std::max(0, lines.size() - static_cast<int>(rpc::kMaxTailLines)); i < lines.size(); ++i) {
    Event& event = added.emplace_back();
    event.SetWorker(worker);
    event.event.set_worker(worker);
    event.event.set_unix_ms(std::clamp<int64_t>(lines[i].unix_ms(), 0, absl::ToUnixMillis(now)));
    event.event.set_level(IsLevel(lines[i].level()) ? lines[i].level() : "info");
    event.event.set_text(rpc::BoundedLine(lines[i].text(), rpc::kMaxTailLineBytes));
    std::string job = logging::JobOf(logging::ParseLine(event.event.text()));
    if (is_known(job)) event.job = std::move(job);
  }
  if (added.empty()) return;
  absl::MutexLock lock(&mutex_);
  WorkerEvents& own = of_workers_[worker];
  own.last_added = ++added_;
  for (Event& event : added) own.kept.Add(std::move(event), kMaxWorkerLines, kMaxWorkerLineBytes);
  if (of_workers_.size() <= kMaxLoggedWorkers) return;
  of_workers_.erase(std::min_element(
      of_workers_.begin(), of_workers_.end(),
      [](const auto& a, const auto& b) { return a.second.last_added < b.second.last_added; }));
}

template <typename Condition>
std::vector<v1::LogEvent> EventLog::Last(int limit, Condition condition) const {
  std::vector<v1::LogEvent> last;
  {
    absl::MutexLock lock(&mutex_);
    const std::deque<Event>& events = events_.events;
    for (auto event = events.rbegin(); event != events.rend() && static_cast<int>(last.size()) < limit;
         ++event) {
      if (condition(*event)) last.push_back(event->event);
    }
    std::reverse(last.begin(), last.end());
    for (const auto& [worker, own] : of_workers_) {
      for (const Event& event : own.kept.events) {
        if (condition(event)) last.push_back(event.event);
      }
    }
  }
  std::stable_sort(last.begin(), last.end(),
                   [](const v1::LogEvent& a, const v1::LogEvent& b) { return a.unix_ms() < b.unix_ms(); });
  if (last.size() > static_cast<size_t>(limit)) last.erase(last.begin(), last.end() - limit);
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
                                                std::shared_ptr<logging::JobLabels> labels,
                                                EventLog* events) {
  const auto keep = [events](const logging::PassedLine& line) {
    if (line.level != "debug") events->Add(line);
  };
  return logging::MakeFrontLogger({.log = log, .labels = std::move(labels), .keep = keep});
}

}  // namespace lumifold::server
