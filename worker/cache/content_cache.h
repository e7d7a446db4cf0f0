#pragma once

#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <set>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/cleanup/cleanup.h"
#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"

namespace lumifold::worker {

/// Keeps values by a key that determines their content. The most recently used are kept within a limit of
/// bytes; a value that someone still uses is found even beyond the limit, because it takes no more memory.
/// Threads: safe concurrently; threads that want a value that is being made wait for it.
template <typename T>
class ContentCache {
 public:
  using Value = std::shared_ptr<const T>;

  explicit ContentCache(uint64_t max_bytes) : max_bytes_(max_bytes) {}

  /// The value of `key`: the one that is kept, or the one that `make` returns. `bytes_of` gives its size.
  /// Errors: those of `make`; they are not kept.
  absl::StatusOr<Value> Get(const std::string& key, absl::FunctionRef<absl::StatusOr<Value>()> make,
                            absl::FunctionRef<uint64_t(const T&)> bytes_of) {
    {
      absl::MutexLock lock(&mutex_);
      const auto is_settled = [&]() ABSL_NO_THREAD_SAFETY_ANALYSIS { return !making_.contains(key); };
      mutex_.Await(absl::Condition(&is_settled));
      if (Value value = Find(key)) return value;
      making_.insert(key);
    }
    // After Keep; also where `make` fails or throws: those who wait for it try in its place.
    const absl::Cleanup settle = [&] {
      absl::MutexLock lock(&mutex_);
      making_.erase(key);
    };
    absl::StatusOr<Value> value = make();
    if (value.ok()) {
      absl::MutexLock lock(&mutex_);
      Keep(key, *value, bytes_of(**value));
    }
    return value;
  }

  /// Keeps no value that nobody else keeps.
  void Drop() {
    absl::MutexLock lock(&mutex_);
    for (auto& [key, entry] : entries_) entry.kept = kept_.end();
    kept_.clear();
    bytes_ = 0;
  }

  /// Of the values that are kept within the limit.
  uint64_t bytes() const {
    absl::MutexLock lock(&mutex_);
    return bytes_;
  }

 private:
  struct Kept {
    std::string key;
    Value value;
    uint64_t bytes = 0;
  };
  using Kepts = std::list<Kept>;
  /// `used` finds a value that only others keep; `kept` is the end of the list then.
  struct Entry {
    std::weak_ptr<const T> used;
    typename Kepts::iterator kept;
    uint64_t bytes = 0;
  };

  Value Find(const std::string& key) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    const auto found = entries_.find(key);
    if (found == entries_.end()) return nullptr;
    Entry& entry = found->second;
    if (entry.kept != kept_.end()) {
      kept_.splice(kept_.begin(), kept_, entry.kept);
      return kept_.front().value;
    }
    Value value = entry.used.lock();
    if (value != nullptr) Keep(key, value, entry.bytes);
    return value;
  }

  void Keep(const std::string& key, const Value& value, uint64_t bytes)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    std::erase_if(entries_, [this](const auto& entry) ABSL_NO_THREAD_SAFETY_ANALYSIS {
      return entry.second.kept == kept_.end() && entry.second.used.expired();
    });
    Entry& entry = entries_.insert_or_assign(key, Entry{value, kept_.end(), bytes}).first->second;
    if (bytes > max_bytes_) return;
    kept_.push_front({key, value, bytes});
    entry.kept = kept_.begin();
    bytes_ += bytes;
    while (bytes_ > max_bytes_) {
      bytes_ -= kept_.back().bytes;
      entries_.at(kept_.back().key).kept = kept_.end();
      kept_.pop_back();
    }
  }

  const uint64_t max_bytes_;
  mutable absl::Mutex mutex_;
  Kepts kept_ ABSL_GUARDED_BY(mutex_);  // most recently used first
  std::map<std::string, Entry> entries_ ABSL_GUARDED_BY(mutex_);
  std::set<std::string> making_ ABSL_GUARDED_BY(mutex_);
  uint64_t bytes_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace lumifold::worker
