#include "server/scheduler/lease_ahead.h"

#include <algorithm>
#include <cmath>

namespace lumifold::scheduler {
namespace {

/// A longer time is that of a machine that is overloaded, not of a network.
constexpr absl::Duration kMaxRoundTrip = absl::Seconds(2);

constexpr int kMaxLeases = 256;
/// Of units that were rendered and wait for the network.
constexpr double kMaxBytes = 64 << 20;

/// Part of a new value in a mean.
constexpr double kNew = 0.125;

}  // namespace

void LeaseAhead::AddRoundTrip(absl::Duration time) {
  time = std::clamp(time, absl::ZeroDuration(), kMaxRoundTrip);
  // A shorter one is nearer to the truth: the others waited for something.
  const bool is_shorter = round_trip_ == absl::ZeroDuration() || time < round_trip_;
  round_trip_ = is_shorter ? time : round_trip_ + kNew * (time - round_trip_);
}

void LeaseAhead::AddUnit(absl::Duration rendering, uint64_t bytes) {
  if (rendering <= absl::ZeroDuration()) return;
  const bool is_first = unit_time_ == absl::ZeroDuration();
  unit_time_ = is_first ? rendering : unit_time_ + kNew * (rendering - unit_time_);
  unit_bytes_ =
      is_first ? static_cast<double>(bytes) : unit_bytes_ + kNew * (static_cast<double>(bytes) - unit_bytes_);
}

int LeaseAhead::Leases(int slots) const {
  if (unit_time_ == absl::ZeroDuration() || round_trip_ <= unit_time_) return 0;
  const double threads = std::max(1, slots / 2);
  const double ahead = threads * absl::FDivDuration(round_trip_ - unit_time_, unit_time_);
  const double fit = unit_bytes_ > 0 ? kMaxBytes / unit_bytes_ : kMaxLeases;
  return static_cast<int>(std::min({std::ceil(ahead), std::floor(fit), double{kMaxLeases}}));
}

}  // namespace lumifold::scheduler
