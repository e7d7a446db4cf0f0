#include "worker/availability/availability.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace lumifold::worker {
namespace {

constexpr absl::Duration kLookInterval = absl::Seconds(1);

}  // namespace

Availability::Availability(AvailabilityOptions options) : options_(std::move(options)) {
  if (options_.max_load.has_value()) load_.emplace(*options_.max_load);
}

std::string Availability::RestReason() {
  std::string load = LoadReason();  // also off hours, so that it is known when they begin
  std::string hours = HoursReason();
  return hours.empty() ? load : hours;
}

std::string Availability::HoursReason() const {
  if (!options_.hours.has_value()) return "";
  const absl::Time now = options_.wall_now();
  if (options_.hours->Include(now, options_.zone)) return "";
  const absl::Time begin = options_.hours->NextBegin(now, options_.zone);
  const bool is_soon = begin - now < absl::Hours(24);
  return absl::StrCat("off hours until ",
                      absl::FormatTime(is_soon ? "%H:%M" : "%a %H:%M", begin, options_.zone));
}

std::string Availability::LoadReason() {
  if (!load_.has_value()) return "";
  if (const absl::Time now = options_.now(); now >= next_look_) {
    next_look_ = now + kLookInterval;
    if (const std::optional<CpuTimes> times = options_.cpu(); times.has_value()) load_->Note(*times, now);
  }
  if (load_->IsIdle()) return "";
  if (!load_->load().has_value()) return "the load of others is being measured";
  if (*load_->load() < *options_.max_load) return "others have used this machine within the last minute";
  return absl::StrFormat("others use this machine, limit %g cores", *options_.max_load);
}

}  // namespace lumifold::worker
