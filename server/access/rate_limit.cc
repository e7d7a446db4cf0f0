#include "server/access/rate_limit.h"

#include <algorithm>

#include "filter/image/check.h"

namespace lumifold::access {

double TokenBuckets::TokensAt(const Bucket& bucket, absl::Time now) const {
  const double gained = per_second_ * std::max(0.0, absl::ToDoubleSeconds(now - bucket.filled));
  return std::min(burst_, bucket.tokens + gained);
}

bool TokenBuckets::Take(const std::string& caller, absl::Time now) {
  absl::MutexLock lock(&mutex_);
  if (buckets_.size() >= forget_at_) ForgetFull(now);
  const auto [entry, is_new] = buckets_.try_emplace(caller, Bucket{burst_, now});
  Bucket& bucket = entry->second;
  bucket = {TokensAt(bucket, now), std::max(bucket.filled, now)};
  if (bucket.tokens < 1) return false;
  bucket.tokens -= 1;
  return true;
}

void TokenBuckets::ForgetFull(absl::Time now) {
  std::erase_if(buckets_, [&](const auto& entry) { return TokensAt(entry.second, now) >= burst_; });
  forget_at_ = std::max<size_t>(64, 2 * buckets_.size());
}

size_t TokenBuckets::size() const {
  absl::MutexLock lock(&mutex_);
  return buckets_.size();
}

bool CallerCounts::Add(const std::string& caller, int limit) {
  absl::MutexLock lock(&mutex_);
  int& count = counts_[caller];
  if (count >= limit) return false;
  ++count;
  return true;
}

void CallerCounts::Remove(const std::string& caller) {
  absl::MutexLock lock(&mutex_);
  const auto found = counts_.find(caller);
  LUMIFOLD_CHECK(found != counts_.end() && found->second > 0);
  if (--found->second == 0) counts_.erase(found);
}

}  // namespace lumifold::access
