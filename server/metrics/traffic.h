#pragma once

#include <atomic>
#include <cstdint>

namespace lumifold::server {

/// Bytes that have passed through a coordinator since its start. Threads: safe.
struct Traffic {
  std::atomic<int64_t> units_received = 0;   // whole units of leases, wanted or not
  std::atomic<int64_t> assets_received = 0;  // in uploads
  std::atomic<int64_t> results_sent = 0;
  std::atomic<int64_t> assets_sent = 0;
  std::atomic<int64_t> units_sent = 0;        // to workers that finish frames
  std::atomic<int64_t> results_received = 0;  // from them
};

}  // namespace lumifold::server
