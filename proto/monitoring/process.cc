#include "proto/monitoring/process.h"

#include <sys/resource.h>
#include <unistd.h>

#include <cstdint>
#include <fstream>
#include <vector>

#include "absl/time/time.h"
#include "proto/monitoring/families.h"

namespace lumifold::monitoring {
namespace {

double ProcessorSeconds() {
  rusage usage = {};
  getrusage(RUSAGE_SELF, &usage);
  return absl::ToDoubleSeconds(absl::DurationFromTimeval(usage.ru_utime) +
                               absl::DurationFromTimeval(usage.ru_stime));
}

/// 0 where /proc is not mounted.
double ResidentBytes() {
  uint64_t pages = 0;
  uint64_t resident = 0;
  std::ifstream("/proc/self/statm") >> pages >> resident;
  return static_cast<double>(resident) * static_cast<double>(sysconf(_SC_PAGESIZE));
}

}  // namespace

std::shared_ptr<prometheus::Collectable> MakeProcessMetrics() {
  return MakeSource([]() -> std::vector<prometheus::MetricFamily> {
    return {
        Counter("process_cpu_seconds_total", "Processor time of this process.", ProcessorSeconds()),
        Gauge("process_resident_memory_bytes", "Memory of this process that is in RAM.", ResidentBytes())};
  });
}

}  // namespace lumifold::monitoring
