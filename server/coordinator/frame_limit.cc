#include "server/coordinator/frame_limit.h"

#include <sys/resource.h>

#include <algorithm>
#include <limits>

#include "server/job/job_spec.h"

namespace lumifold::server {
namespace {

constexpr size_t kMostOpenLogs = 256;
constexpr uint64_t kDiskShare = 2;     // one in
constexpr uint64_t kMemoryShare = 16;  // one in
/// Memory that the coordinator needs for a unit of a frame in flight: the scheduler's bit, and the lists of
/// an assembly or a check of the frame.
constexpr uint64_t kUnitMemoryBytes = 64;
constexpr uint64_t kAssumedFloats = 120;

}  // namespace

FrameDemand DemandOf(const v1::JobSpec& spec, const job::FrameUnits& units, const UnitBytes& known) {
  // With adaptive sampling about as many passes as without: their number grows with the logarithm of the
  // samples.
  const auto passes =
      static_cast<uint64_t>(1 + (units.is_adaptive() ? job::kDefaultMaxPasses / 2 : units.pass_count()));
  const auto count = static_cast<uint64_t>(units.tiles().count()) * passes;
  if (known.units > 0) return {count * (known.bytes / static_cast<uint64_t>(known.units)), units.count()};
  const auto pixels = static_cast<uint64_t>(spec.width()) * static_cast<uint64_t>(spec.height());
  return {pixels * passes * kAssumedFloats * sizeof(float), units.count()};
}

int MaxActiveFrames(const FrameResources& resources, const FrameDemand& demand) {
  const uint64_t by_disk = resources.free_disk_bytes / kDiskShare / std::max<uint64_t>(demand.log_bytes, 1);
  const uint64_t unit_bytes = static_cast<uint64_t>(std::max<int64_t>(demand.units, 1)) * kUnitMemoryBytes;
  const uint64_t by_memory = resources.memory_bytes / kMemoryShare / unit_bytes;
  const uint64_t frames = std::min({uint64_t{resources.open_logs}, by_disk, by_memory});
  return static_cast<int>(std::clamp<uint64_t>(frames, 1, std::numeric_limits<int>::max()));
}

size_t MaxOpenLogs() {
  rlimit limit = {};
  if (getrlimit(RLIMIT_NOFILE, &limit) != 0) return 1;
  return std::clamp<size_t>(limit.rlim_cur / 4, 1, kMostOpenLogs);
}

void FrameLimit::Reset(uint64_t free_disk_bytes) {
  resources_.free_disk_bytes = free_disk_bytes;
  largest_ = {};
}

void FrameLimit::Add(const FrameDemand& demand) {
  largest_.log_bytes = std::max(largest_.log_bytes, demand.log_bytes);
  largest_.units = std::max(largest_.units, demand.units);
}

}  // namespace lumifold::server
