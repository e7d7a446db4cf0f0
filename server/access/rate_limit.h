#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"

namespace lumifold::access {

/// Bounds how often each caller does something: a bucket for each holds up to `burst` tokens and gains
/// `per_second`.
/// Memory: only callers whose bucket is not full have an entry.
/// Threads: safe.
class TokenBuckets {
 public:
  /// Both at least 1.
  TokenBuckets(double per_second, double burst) : per_second_(per_second), burst_(burst) {}

  /// Takes a token of the caller's bucket at `now`, of a monotonic clock. False: it has none.
  bool Take(const std::string& caller, absl::Time now);

  double per_second() const { return per_second_; }
  size_t size() const;

 private:
  struct Bucket {
    double tokens = 0;
    absl::Time filled;
  };
  double TokensAt(const Bucket& bucket, absl::Time now) const;
  void ForgetFull(absl::Time now) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const double per_second_;
  const double burst_;
  mutable absl::Mutex mutex_;
  std::map<std::string, Bucket> buckets_ ABSL_GUARDED_BY(mutex_);
  /// Number of entries at which those that are full are forgotten; at least twice as many as there were then.
  size_t forget_at_ ABSL_GUARDED_BY(mutex_) = 64;
};

/// Counts what each caller has at a time.
/// Threads: safe.
class CallerCounts {
 public:
  /// False where the caller has `limit` already.
  bool Add(const std::string& caller, int limit);
  void Remove(const std::string& caller);

 private:
  absl::Mutex mutex_;
  std::map<std::string, int> counts_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace lumifold::access
