#include "server/commit/open_logs.h"

#include <limits>

namespace lumifold::server {

absl::StatusOr<film::UnitLog*> OpenLogs::Get(const FrameKey& frame,
                                             absl::FunctionRef<absl::StatusOr<film::UnitLog>()> open) {
  const auto found = logs_.find(frame);
  if (found != logs_.end()) {
    uses_.splice(uses_.end(), uses_, found->second.use);
    return &found->second.log;
  }
  if (logs_.size() >= max_open_) Close(uses_.front());
  absl::StatusOr<film::UnitLog> log = open();
  if (!log.ok()) return log.status();
  const auto use = uses_.insert(uses_.end(), frame);
  return &logs_.emplace(frame, Entry{*std::move(log), use}).first->second.log;
}

void OpenLogs::Close(const FrameKey& frame) {
  const auto found = logs_.find(frame);
  if (found == logs_.end()) return;
  uses_.erase(found->second.use);
  logs_.erase(found);
}

void OpenLogs::CloseAll(const job::JobId& job) {
  auto entry = logs_.lower_bound({job, std::numeric_limits<int32_t>::min()});
  while (entry != logs_.end() && entry->first.first == job) {
    uses_.erase(entry->second.use);
    entry = logs_.erase(entry);
  }
}

}  // namespace lumifold::server
