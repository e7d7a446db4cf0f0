#pragma once

#include <array>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"

namespace lumifold::worker {

/// Hours of the week by the clock on the wall, such as "19:00-07:00" (each day) or
/// "Mon-Fri 19:00-07:00,Sat-Sun 00:00-24:00". A range that ends before it begins ends on the next day. When
/// the clock is changed, an hour that it skips is in no range, and one that it repeats is in its range twice.
class WorkingHours {
 public:
  /// Errors: kInvalidArgument with the expected format.
  static absl::StatusOr<WorkingHours> Parse(absl::string_view text);

  bool Include(absl::Time now, const absl::TimeZone& zone) const;
  /// When the hours begin next, after `now`, which they do not include.
  absl::Time NextBegin(absl::Time now, const absl::TimeZone& zone) const;

 private:
  struct Range {
    std::array<bool, 7> days{};  // on which it begins; the first is Monday
    int begin = 0;               // minutes of the day
    int end = 0;                 // at most those of a day; not above `begin`: of the next day
  };
  static absl::StatusOr<Range> ParseRange(absl::string_view text);

  std::vector<Range> ranges_;
};

}  // namespace lumifold::worker
