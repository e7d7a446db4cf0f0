#include "worker/availability/working_hours.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

namespace lumifold::worker {
namespace {

absl::TimeZone Berlin() {
  absl::TimeZone zone;
  EXPECT_TRUE(absl::LoadTimeZone("Europe/Berlin", &zone));
  return zone;
}

WorkingHours Hours(const std::string& text) {
  const absl::StatusOr<WorkingHours> hours = WorkingHours::Parse(text);
  EXPECT_TRUE(hours.ok()) << hours.status();
  return hours.value_or(WorkingHours());
}

/// Of November 2026, which begins on a Sunday.
absl::Time At(int day, int hour, int minute) {
  return absl::FromCivil(absl::CivilMinute(2026, 11, day, hour, minute), Berlin());
}

TEST(WorkingHours, OfEachDayMayPassMidnight) {
  const WorkingHours hours = Hours("19:00-07:00");
  for (const auto& [hour, minute, included] :
       {std::tuple{0, 0, true}, {6, 59, true}, {7, 0, false}, {18, 59, false}, {19, 0, true}, {23, 59, true}})
    EXPECT_EQ(hours.Include(At(4, hour, minute), Berlin()), included) << hour << ":" << minute;
  EXPECT_EQ(hours.NextBegin(At(4, 7, 0), Berlin()), At(4, 19, 0));
}

TEST(WorkingHours, OfSomeDaysBeginOnThem) {
  const WorkingHours hours = Hours("Mon-Fri 19:00-07:00,sat-SUN 00:00-24:00");
  EXPECT_TRUE(hours.Include(At(1, 12, 0), Berlin())) << "Sunday";
  EXPECT_FALSE(hours.Include(At(2, 0, 0), Berlin())) << "Monday, and Sunday has no night";
  EXPECT_TRUE(hours.Include(At(2, 19, 0), Berlin()));
  EXPECT_TRUE(hours.Include(At(3, 6, 59), Berlin()));
  EXPECT_FALSE(hours.Include(At(6, 12, 0), Berlin())) << "Friday";
  EXPECT_TRUE(hours.Include(At(7, 6, 0), Berlin()));
  EXPECT_EQ(hours.NextBegin(At(6, 12, 0), Berlin()), At(6, 19, 0));
  EXPECT_EQ(Hours("Wed 12:00-13:00").NextBegin(At(4, 13, 0), Berlin()), At(11, 12, 0));
  EXPECT_TRUE(Hours("Sat-Mon 12:00-13:00").Include(At(1, 12, 30), Berlin()));
  EXPECT_FALSE(Hours("Sat-Mon 12:00-13:00").Include(At(3, 12, 30), Berlin()));
}

TEST(WorkingHours, FollowTheClockThatIsChanged) {
  // On 25 October 2026 the hour from 2 comes twice, on 29 March it does not come.
  const WorkingHours night = Hours("02:00-03:00");
  const absl::Time autumn = absl::FromCivil(absl::CivilHour(2026, 10, 25, 1), Berlin());
  const absl::Time spring = absl::FromCivil(absl::CivilHour(2026, 3, 29, 1), Berlin());
  int in_autumn = 0;
  int in_spring = 0;
  for (int minute = 0; minute < 240; ++minute) {
    in_autumn += night.Include(autumn + absl::Minutes(minute), Berlin()) ? 1 : 0;
    in_spring += night.Include(spring + absl::Minutes(minute), Berlin()) ? 1 : 0;
  }
  EXPECT_EQ(in_autumn, 120);
  EXPECT_EQ(in_spring, 0);
  EXPECT_GT(night.NextBegin(spring, Berlin()), spring);
  EXPECT_TRUE(Hours("00:00-24:00").Include(spring + absl::Minutes(61), Berlin()));
}

TEST(WorkingHours, OtherTextsAreRefused) {
  for (const char* text : {"", "19:00", "19-07", "19:00-19:00", "24:00-07:00", "19:60-20:00", "25:00-26:00",
                           "19:00-07:00,", "Mon", "1:00-2:00", "Foo 19:00-07:00", "Mon-Fri-Sun 19:00-07:00",
                           "Mon,Tue 19:00-07:00", "19:00-07:00-08:00", "-1:00-02:00"}) {
    EXPECT_EQ(WorkingHours::Parse(text).status().code(), absl::StatusCode::kInvalidArgument) << text;
  }
}

}  // namespace
}  // namespace lumifold::worker
