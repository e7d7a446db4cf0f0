#include "server/job/frame_list.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <vector>

#include "server/job/limits.h"

namespace lumifold::job {
namespace {

using ::testing::HasSubstr;

struct Range {
  int first;
  int count;
};

v1::JobSpec Frames(Range first, const std::vector<Range>& more) {
  v1::JobSpec spec;
  spec.set_first_frame(first.first);
  spec.set_frame_count(first.count);
  for (const Range& range : more) {
    spec.add_more_frames()->set_first(range.first);
    spec.mutable_more_frames(spec.more_frames_size() - 1)->set_count(range.count);
  }
  return spec;
}

TEST(FrameList, IndexAndNumberAreInversesOverGaps) {
  const v1::JobSpec spec = Frames({-2, 3}, {{1, 1}, {5, 2}, {100, 1}});
  ASSERT_TRUE(FrameList::Check(spec).ok());
  const FrameList frames(spec);
  const std::vector<int> numbers{-2, -1, 0, 1, 5, 6, 100};
  ASSERT_EQ(frames.count(), 7);
  for (int i = 0; i < frames.count(); ++i) {
    EXPECT_EQ(frames.NumberOf(i), numbers[static_cast<size_t>(i)]);
    EXPECT_EQ(frames.IndexOf(frames.NumberOf(i)), i);
  }
  for (const int32_t gap :
       {-3, 2, 4, 7, 99, 101, std::numeric_limits<int32_t>::min(), std::numeric_limits<int32_t>::max()}) {
    EXPECT_FALSE(frames.IndexOf(gap).has_value()) << gap;
  }
}

TEST(FrameList, RefusesFramesThatAreNotAscendingOrTooMany) {
  const auto error = [](const v1::JobSpec& spec) { return std::string(FrameList::Check(spec).message()); };
  EXPECT_THAT(error(Frames({1, 0}, {})), HasSubstr("frame_count is 0"));
  EXPECT_THAT(error(Frames({2147483647, 1}, {})), HasSubstr("first_frame is 2147483647"));
  EXPECT_THAT(error(Frames({1, 5}, {{5, 1}})), HasSubstr("more_frames[0].first is 5, not 6 to"));
  EXPECT_THAT(error(Frames({1, 5}, {{8, 2}, {7, 1}})), HasSubstr("more_frames[1].first is 7, not 10 to"));
  EXPECT_THAT(error(Frames({1, 5}, {{8, 0}})), HasSubstr("more_frames[0].count is 0"));
  EXPECT_THAT(error(Frames({1, 5}, {{2147483647, 1}})), HasSubstr("more_frames[0].first is 2147483647"));
  EXPECT_THAT(error(Frames({1, kMaxFrames}, {{1'000'000, 1}})), HasSubstr("the number of frames is 100001"));
  EXPECT_THAT(error(Frames({0, 1}, std::vector<Range>(kMaxFrameRanges + 1, Range{7, 1}))),
              HasSubstr("the number of more_frames is 1025"));
}

TEST(FrameList, HoldsABoundedNumberOfFramesOfADamagedSpec) {
  const FrameList frames(Frames({0, -5}, {{3, 2147483647}, {9, 7}}));
  EXPECT_EQ(frames.count(), kMaxFrames);
  EXPECT_EQ(frames.NumberOf(0), 3);
}

}  // namespace
}  // namespace lumifold::job
