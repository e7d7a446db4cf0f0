#include "worker/availability/others_load.h"

#include <fcntl.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cstddef>
#include <string>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"

namespace lumifold::worker {
namespace {

constexpr char kStatFile[] = "/proc/stat";

/// Fields of the line "cpu" of /proc/stat, after its name: proc(5).
enum Field : size_t { kUser, kNice, kSystem, kIdle, kIoWait, kIrq, kSoftIrq, kSteal, kFields };

/// Seconds that the cores were busy; nullopt for another text. Time of guests is in that of kUser.
std::optional<double> BusySeconds(absl::string_view stat) {
  const std::vector<absl::string_view> words =
      absl::StrSplit(stat.substr(0, stat.find('\n')), ' ', absl::SkipEmpty());
  if (words.size() < 1 + kFields || words[0] != "cpu") return std::nullopt;
  double ticks = 0;
  for (const Field field : {kUser, kNice, kSystem, kIrq, kSoftIrq}) {
    double value = 0;
    if (!absl::SimpleAtod(words[1 + field], &value)) return std::nullopt;
    ticks += value;
  }
  return ticks / static_cast<double>(sysconf(_SC_CLK_TCK));
}

}  // namespace

absl::StatusOr<std::unique_ptr<CpuClock>> CpuClock::Open() {
  const int file = open(kStatFile, O_RDONLY | O_CLOEXEC);
  if (file < 0) return absl::UnavailableError("/proc/stat cannot be opened: it has the load of the machine");
  std::unique_ptr<CpuClock> clock(new CpuClock(file));
  if (!clock->Read().has_value())
    return absl::UnavailableError("/proc/stat has no line about its processors");
  return clock;
}

CpuClock::~CpuClock() { close(file_); }

std::optional<CpuTimes> CpuClock::Read() const {
  char buffer[1024];  // the line comes first
  const ssize_t size = pread(file_, buffer, sizeof buffer, 0);
  timespec own = {};
  if (size <= 0 || clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &own) != 0) return std::nullopt;
  const std::optional<double> machine = BusySeconds({buffer, static_cast<size_t>(size)});
  if (!machine.has_value()) return std::nullopt;
  return CpuTimes{*machine, static_cast<double>(own.tv_sec) + 1e-9 * static_cast<double>(own.tv_nsec)};
}

void OthersLoad::Note(const CpuTimes& times, absl::Time now) {
  samples_.push_back({now, times.machine - times.own});
  while (samples_.size() > 2 && now - samples_[1].time >= kWindow) samples_.pop_front();
  const Sample& first = samples_.front();
  if (now - first.time < kWindow) return;
  // The kernel counts in ticks, and both clocks are read one after the other.
  load_ = std::max(0.0, (samples_.back().others - first.others) / absl::ToDoubleSeconds(now - first.time));
  calm_since_ = *load_ < limit_ ? std::min(calm_since_, first.time) : absl::InfiniteFuture();
  is_idle_ = calm_since_ != absl::InfiniteFuture() && (is_idle_ || now - calm_since_ >= kCalm);
}

}  // namespace lumifold::worker
