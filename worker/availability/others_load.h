#pragma once

#include <deque>
#include <memory>
#include <optional>

#include "absl/status/statusor.h"
#include "absl/time/time.h"

namespace lumifold::worker {

/// Processor time since some moment, in seconds of one core.
struct CpuTimes {
  double machine = 0;  // of all processes
  double own = 0;      // of this one
};

/// Reads processor times. The file of the kernel is opened once: in the sandbox it cannot be.
class CpuClock {
 public:
  /// Errors: kUnavailable where the machine does not tell.
  static absl::StatusOr<std::unique_ptr<CpuClock>> Open();
  ~CpuClock();
  CpuClock(const CpuClock&) = delete;
  CpuClock& operator=(const CpuClock&) = delete;

  /// nullopt where it cannot be read.
  std::optional<CpuTimes> Read() const;

 private:
  explicit CpuClock(int file) : file_(file) {}

  const int file_;
};

/// Whether nobody else uses a machine: how many cores the processes besides this one keep busy, and a limit.
/// A machine is in use as soon as its load over kWindow reaches the limit, and idle again once it has stayed
/// below for kCalm, so that a pause of whoever works there is no reason to begin. Pure state.
class OthersLoad {
 public:
  static constexpr absl::Duration kWindow = absl::Seconds(10);
  static constexpr absl::Duration kCalm = absl::Minutes(1);

  explicit OthersLoad(double limit) : limit_(limit) {}

  /// To be called about once a second. `now` does not decrease.
  void Note(const CpuTimes& times, absl::Time now);
  /// Mean over the last kWindow; nullopt until it has passed.
  std::optional<double> load() const { return load_; }
  /// False until kCalm has passed.
  bool IsIdle() const { return is_idle_; }

 private:
  struct Sample {
    absl::Time time;
    double others = 0;
  };

  const double limit_;
  std::deque<Sample> samples_;  // the first is kWindow old or older
  std::optional<double> load_;
  absl::Time calm_since_ = absl::InfiniteFuture();
  bool is_idle_ = false;
};

}  // namespace lumifold::worker
