#pragma once

#include <cstdint>
#include <memory>
#include <string_view>

struct XXH3_state_s;

namespace lumifold::rpc {

/// XXH3-64 of `bytes`: detects accidental damage, not tampering.
uint64_t Checksum(std::string_view bytes);

/// Checksum of bytes that are not in one place.
class RunningChecksum {
 public:
  RunningChecksum();

  void Add(std::string_view bytes);
  /// Checksum of the bytes added so far.
  uint64_t Value() const;

 private:
  struct Free {
    void operator()(XXH3_state_s* state) const;
  };
  std::unique_ptr<XXH3_state_s, Free> state_;
};

}  // namespace lumifold::rpc
