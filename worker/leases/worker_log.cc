#include "worker/leases/worker_log.h"

#include <spdlog/logger.h>

#include <iterator>
#include <string>
#include <utility>

#include "absl/time/time.h"
#include "proto/rpc/bounded_text.h"
#include "proto/rpc/limits.h"

namespace lumifold::worker {

void LogTail::Add(const logging::PassedLine& line) {
  v1::LogEvent event;
  event.set_unix_ms(absl::ToUnixMillis(absl::FromChrono(line.time)));
  event.set_level(std::string(line.level));
  event.set_text(rpc::BoundedLine(line.text, rpc::kMaxTailLineBytes));
  absl::MutexLock lock(&mutex_);
  lines_.push_back(std::move(event));
  if (lines_.size() > rpc::kMaxTailLines) lines_.pop_front();
}

std::vector<v1::LogEvent> LogTail::Take() {
  absl::MutexLock lock(&mutex_);
  std::vector<v1::LogEvent> taken(std::make_move_iterator(lines_.begin()),
                                  std::make_move_iterator(lines_.end()));
  lines_.clear();
  return taken;
}

WorkerLog MakeWorkerLog(std::shared_ptr<spdlog::logger> log) {
  WorkerLog made;
  made.log = logging::MakeFrontLogger(
      {.log = std::move(log),
       .labels = made.labels,
       .keep = [tail = made.tail](const logging::PassedLine& line) { tail->Add(line); }});
  return made;
}

WorkerLog SilentLog() { return {.log = std::make_shared<spdlog::logger>("null")}; }

}  // namespace lumifold::worker
