#include "server/storage/storage_state.h"

#include <spdlog/logger.h>

#include <utility>

#include "proto/logging/fields.h"
#include "proto/retry/storage_away.h"

namespace lumifold::server {

bool IsStorageError(const absl::Status& status) {
  return absl::IsUnavailable(status) || absl::IsDataLoss(status);
}

StorageState::StorageState(std::function<absl::Time()> wall_now, std::shared_ptr<spdlog::logger> log)
    : wall_now_(std::move(wall_now)), log_(std::move(log)) {}

absl::Status StorageState::status() const {
  const std::optional<Outage> now = outage();
  return now.has_value() ? now->answer : absl::OkStatus();
}

std::optional<StorageState::Outage> StorageState::outage() const {
  absl::MutexLock lock(&mutex_);
  return outage_;
}

void StorageState::Fail(const absl::Status& cause) {
  const std::string error(cause.message());
  bool begins = false;
  {
    absl::MutexLock lock(&mutex_);
    begins = !outage_.has_value();
    if (begins) outage_ = Outage{error, retry::StorageAway(cause), wall_now_()};
  }
  if (begins) {
    log_->error("event=storage_unavailable error={}", logging::Quoted(error));
    on_change_(false);
  }
  on_fail_();
}

void StorageState::Recover() {
  std::optional<Outage> ended;
  {
    absl::MutexLock lock(&mutex_);
    ended = std::exchange(outage_, std::nullopt);
  }
  if (!ended.has_value()) return;
  log_->info("event=storage_available ended_error={}", logging::Quoted(ended->error));
  on_change_(true);
}

}  // namespace lumifold::server
