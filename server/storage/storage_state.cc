#include "server/storage/storage_state.h"

#include <spdlog/logger.h>

#include <utility>

#include "absl/strings/str_cat.h"
#include "proto/logging/fields.h"

namespace lumifold::server {

bool IsStorageError(const absl::Status& status) {
  return absl::IsUnavailable(status) || absl::IsDataLoss(status);
}

StorageState::StorageState(std::function<absl::Time()> wall_now, std::shared_ptr<spdlog::logger> log)
    : wall_now_(std::move(wall_now)), log_(std::move(log)) {}

absl::Status StorageState::status() const {
  const std::optional<Outage> now = outage();
  if (!now.has_value()) return absl::OkStatus();
  return absl::ResourceExhaustedError(
      absl::StrCat("the coordinator cannot write to its storage, try again later: ", now->error));
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
    if (begins) outage_ = Outage{error, wall_now_()};
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
