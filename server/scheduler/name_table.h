#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <utility>

namespace lumifold::scheduler {

/// Numbers for names, so that a table of millions of entries can name workers in four bytes each. A name has
/// its number while it is referred to; 0 is the number of no name. Every call takes O(log n).
///
/// Threads: one at a time.
class NameTable {
 public:
  /// The number of a name, which is referred to once more.
  uint32_t Acquire(const std::string& name) {
    const auto [it, is_new] = numbers_.emplace(name, next_);
    if (is_new) entries_[next_++].first = &it->first;
    ++entries_.at(it->second).second;
    return it->second;
  }
  /// Ends one reference; no effect for 0.
  void Release(uint32_t number) {
    if (number == 0) return;
    const auto entry = entries_.find(number);
    if (--entry->second.second > 0) return;
    numbers_.erase(numbers_.find(*entry->second.first));
    entries_.erase(entry);
  }
  /// 0 for a name that nothing refers to.
  uint32_t Find(const std::string& name) const {
    const auto found = numbers_.find(name);
    return found == numbers_.end() ? 0 : found->second;
  }
  /// Empty for 0.
  std::string NameOf(uint32_t number) const { return number == 0 ? "" : *entries_.at(number).first; }

 private:
  uint32_t next_ = 1;
  std::map<std::string, uint32_t> numbers_;
  std::map<uint32_t, std::pair<const std::string*, int64_t>> entries_;  // name and number of references
};

}  // namespace lumifold::scheduler
