#include "proto/logging/event_limit.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

namespace lumifold::logging {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using Dropped = EventLimit::Dropped;

EventLimit::Time At(int ms) {
  return EventLimit::Time(std::chrono::hours(1) + std::chrono::milliseconds(ms));
}

/// How many of `lines` lines pass.
int Admitted(EventLimit* limit, int ms, const std::string& event, int lines, bool is_debug = false) {
  int admitted = 0;
  for (int i = 0; i < lines; ++i) admitted += limit->Admit(At(ms), is_debug, event) ? 1 : 0;
  return admitted;
}

TEST(EventLimit, DropsWhatComesTooOftenInASecond) {
  EventLimit limit({.lines = 3, .debug_lines = 5});
  EXPECT_EQ(Admitted(&limit, 0, "a", 2), 2);
  EXPECT_EQ(Admitted(&limit, 999, "a", 4), 1);
  EXPECT_EQ(Admitted(&limit, 999, "b", 1), 1);
  EXPECT_EQ(Admitted(&limit, 999, "c", 9, /*is_debug=*/true), 5);
  EXPECT_THAT(limit.TakeDropped(), IsEmpty()) << "the second has not ended";
  EXPECT_EQ(Admitted(&limit, 1000, "a", 4), 3);
  EXPECT_THAT(limit.TakeDropped(), ElementsAre(Dropped{"a", 3}, Dropped{"c", 4}));
  EXPECT_THAT(limit.TakeDropped(), IsEmpty());
  limit.EndSecond();
  EXPECT_THAT(limit.TakeDropped(), ElementsAre(Dropped{"a", 1}));
}

TEST(EventLimit, GoesOnWhenTheClockGoesBack) {
  EventLimit limit({.lines = 1});
  EXPECT_EQ(Admitted(&limit, 100'000, "a", 2), 1);
  EXPECT_EQ(Admitted(&limit, 0, "a", 2), 1);
  EXPECT_THAT(limit.TakeDropped(), ElementsAre(Dropped{"a", 1}));
}

TEST(EventLimit, CountsFurtherEventsAsOne) {
  EventLimit limit({.lines = 2, .events = 3});
  int admitted = 0;
  for (int i = 0; i < 1000; ++i) admitted += Admitted(&limit, 0, "event" + std::to_string(i), 1);
  EXPECT_EQ(admitted, 3 + 2);
  limit.EndSecond();
  EXPECT_THAT(limit.TakeDropped(), ElementsAre(Dropped{"further_events", 995}));
}

}  // namespace
}  // namespace lumifold::logging
