#include "server/job/gaps.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace lumifold::job {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::SizeIs;

v1::Gaps GapsOf(const std::vector<int32_t>& frames) {
  v1::Gaps gaps;
  SetSkipped(frames, &gaps);
  return gaps;
}

TEST(Gaps, AreFramesAsRanges) {
  const v1::Gaps gaps = GapsOf({-2, 17, 20, 21, 22});
  EXPECT_THAT(gaps.skipped(), SizeIs(3));
  EXPECT_THAT(SkippedFrames(gaps), ElementsAre(-2, 17, 20, 21, 22));
  EXPECT_EQ(CountSkipped(gaps), 5);
  EXPECT_EQ(TextOf(gaps), "-2,17,20-22");
  for (const int32_t frame : {-2, 17, 20, 22}) EXPECT_TRUE(job::IsSkipped(gaps, frame)) << frame;
  for (const int32_t frame : {-3, -1, 0, 16, 18, 19, 23, INT32_MAX, INT32_MIN})
    EXPECT_FALSE(job::IsSkipped(gaps, frame)) << frame;
}

TEST(Gaps, MayBeNone) {
  EXPECT_THAT(SkippedFrames({}), IsEmpty());
  EXPECT_EQ(TextOf(v1::Gaps()), "");
  EXPECT_FALSE(job::IsSkipped({}, 0));
}

TEST(Gaps, OfADamagedRowAreBounded) {
  v1::Gaps gaps;
  for (int i = 0; i < 3; ++i) gaps.add_skipped()->set_count(INT32_MAX);
  EXPECT_THAT(SkippedFrames(gaps), SizeIs(100'000));
  EXPECT_EQ(CountSkipped(gaps), 100'000);
}

TEST(Gaps, AJobSkipsAFewFramesOrLessThanHalf) {
  EXPECT_TRUE(MaySkipAnother(0, 0, 2));
  EXPECT_FALSE(MaySkipAnother(1, 0, 2)) << "no frame would be left";
  EXPECT_TRUE(MaySkipAnother(9, 0, 100));
  EXPECT_FALSE(MaySkipAnother(10, 10, 100));
  EXPECT_TRUE(MaySkipAnother(10, 11, 100));
}

}  // namespace
}  // namespace lumifold::job
