#include "proto/logging/event_limit.h"

#include <utility>

namespace lumifold::logging {
namespace {

/// Of all events over EventLimits::events.
constexpr std::string_view kFurtherEvents = "further_events";

}  // namespace

bool EventLimit::Admit(Time time, bool is_debug, std::string_view event) {
  if (time < second_ || time - second_ >= std::chrono::seconds(1)) {
    EndSecond();
    second_ = time;
  }
  auto found = counts_.find(event);
  if (found == counts_.end()) {
    const std::string_view name = counts_.size() < limits_.events ? event : kFurtherEvents;
    found = counts_.try_emplace(std::string(name)).first;
  }
  Count& count = found->second;
  if (count.lines < (is_debug ? limits_.debug_lines : limits_.lines)) {
    ++count.lines;
    return true;
  }
  ++count.dropped;
  return false;
}

std::vector<EventLimit::Dropped> EventLimit::TakeDropped() { return std::exchange(dropped_, {}); }

void EventLimit::EndSecond() {
  for (const auto& [event, count] : counts_) {
    if (count.dropped > 0) dropped_.push_back({event, count.dropped});
  }
  counts_.clear();
}

}  // namespace lumifold::logging
