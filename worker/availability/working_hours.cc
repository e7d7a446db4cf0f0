#include "worker/availability/working_hours.h"

#include <algorithm>
#include <cstddef>
#include <optional>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"

namespace lumifold::worker {
namespace {

constexpr int kDayMinutes = 24 * 60;
constexpr int kDays = 7;
constexpr std::array<absl::string_view, kDays> kDayNames = {"mon", "tue", "wed", "thu", "fri", "sat", "sun"};

std::optional<int> ParseDay(absl::string_view text) {
  const auto found = std::find(kDayNames.begin(), kDayNames.end(), absl::AsciiStrToLower(text));
  if (found == kDayNames.end()) return std::nullopt;
  return static_cast<int>(found - kDayNames.begin());
}

/// "Mon", "Mon-Fri" or "Sat-Mon".
std::optional<std::array<bool, kDays>> ParseDays(absl::string_view text) {
  const std::vector<absl::string_view> ends = absl::StrSplit(text, '-');
  const std::optional<int> first = ParseDay(ends.front());
  const std::optional<int> last = ParseDay(ends.back());
  if (ends.size() > 2 || !first.has_value() || !last.has_value()) return std::nullopt;
  std::array<bool, kDays> days{};
  for (int day = *first;; day = (day + 1) % kDays) {
    days[static_cast<size_t>(day)] = true;
    if (day == *last) return days;
  }
}

/// "07:00"; minutes from 0 to those of a day.
std::optional<int> ParseTime(absl::string_view text) {
  const bool has_form = text.size() == 5 && text[2] == ':' && absl::ascii_isdigit(text[0]) &&
                        absl::ascii_isdigit(text[1]) && absl::ascii_isdigit(text[3]) &&
                        absl::ascii_isdigit(text[4]);
  if (!has_form) return std::nullopt;
  const int minute = 10 * (text[3] - '0') + text[4] - '0';
  const int time = 60 * (10 * (text[0] - '0') + text[1] - '0') + minute;
  return minute < 60 && time <= kDayMinutes ? std::optional(time) : std::nullopt;
}

size_t DayOf(absl::CivilDay day) { return static_cast<size_t>(absl::GetWeekday(day)); }

absl::Status WrongFormat(absl::string_view text) {
  return absl::InvalidArgumentError(absl::StrCat(
      "expected hours such as 19:00-07:00 or 'Mon-Fri 19:00-07:00,Sat-Sun 00:00-24:00'; got '", text, "'"));
}

}  // namespace

absl::StatusOr<WorkingHours::Range> WorkingHours::ParseRange(absl::string_view text) {
  Range range;
  range.days.fill(true);
  absl::string_view hours = absl::StripAsciiWhitespace(text);
  if (const size_t space = hours.find(' '); space != absl::string_view::npos) {
    const std::optional<std::array<bool, kDays>> days = ParseDays(hours.substr(0, space));
    if (!days.has_value()) return WrongFormat(text);
    range.days = *days;
    hours = absl::StripLeadingAsciiWhitespace(hours.substr(space));
  }
  const std::vector<absl::string_view> ends = absl::StrSplit(hours, '-');
  const std::optional<int> begin = ParseTime(ends.front());
  const std::optional<int> end = ParseTime(ends.back());
  if (ends.size() != 2 || !begin.has_value() || !end.has_value() || *begin == *end || *begin == kDayMinutes)
    return WrongFormat(text);
  range.begin = *begin;
  range.end = *end;
  return range;
}

absl::StatusOr<WorkingHours> WorkingHours::Parse(absl::string_view text) {
  WorkingHours hours;
  for (const absl::string_view part : absl::StrSplit(text, ',')) {
    absl::StatusOr<Range> range = ParseRange(part);
    if (!range.ok()) return range.status();
    hours.ranges_.push_back(*range);
  }
  return hours;
}

bool WorkingHours::Include(absl::Time now, const absl::TimeZone& zone) const {
  const absl::CivilMinute time = absl::ToCivilMinute(now, zone);
  const absl::CivilDay today(time);
  const int minute = static_cast<int>(time - absl::CivilMinute(today));
  return std::any_of(ranges_.begin(), ranges_.end(), [&](const Range& range) {
    const bool began_today = range.days[DayOf(today)];
    if (range.begin < range.end) return began_today && minute >= range.begin && minute < range.end;
    return (began_today && minute >= range.begin) || (range.days[DayOf(today - 1)] && minute < range.end);
  });
}

absl::Time WorkingHours::NextBegin(absl::Time now, const absl::TimeZone& zone) const {
  absl::Time next = absl::InfiniteFuture();
  const absl::CivilDay today = absl::ToCivilDay(now, zone);
  for (int days = 0; days <= kDays; ++days) {
    for (const Range& range : ranges_) {
      if (!range.days[DayOf(today + days)]) continue;
      const absl::Time begin = absl::FromCivil(absl::CivilMinute(today + days) + range.begin, zone);
      if (begin > now) next = std::min(next, begin);
    }
  }
  return next;
}

}  // namespace lumifold::worker
