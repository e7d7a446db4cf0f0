#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace lumifold::logging {

/// How often an event may be logged.
struct EventLimits {
  /// Lines of one event in a second, at info and above: errors too, of which the hundredth in a second says
  /// nothing new. Half of it would drop lines of a worker's connections when a thousand workers join; twice
  /// as many cost 3 GB a day.
  int lines = 100;
  /// The same for debug, which is switched on to see each unit.
  int debug_lines = 1000;
  /// Events that are told apart within a second; further ones count as one.
  size_t events = 256;
};

/// Counts lines in seconds, the next of which begins with the first line after the last one's end.
/// Threads: one at a time.
class EventLimit {
 public:
  using Time = std::chrono::system_clock::time_point;
  struct Dropped {
    std::string event;
    int64_t lines = 0;
    bool operator==(const Dropped&) const = default;
  };

  explicit EventLimit(const EventLimits& limits) : limits_(limits) {}

  /// Whether this line may be written. `time` may go back.
  bool Admit(Time time, bool is_debug, std::string_view event);
  /// What was dropped in seconds that have ended, each event once a second. To be called after Admit.
  std::vector<Dropped> TakeDropped();
  /// The current second ends.
  void EndSecond();

 private:
  struct Count {
    int lines = 0;
    int64_t dropped = 0;
  };

  const EventLimits limits_;
  Time second_ = {};
  std::map<std::string, Count, std::less<>> counts_;
  std::vector<Dropped> dropped_;
};

}  // namespace lumifold::logging
