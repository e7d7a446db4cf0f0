#include "proto/logging/job_labels.h"

#include <gtest/gtest.h>

#include "proto/logging/fields.h"

namespace lumifold::logging {
namespace {

TEST(JobLabels, ForgetsTheLeastRecentlyUsed) {
  JobLabels labels(/*max_jobs=*/2);
  labels.Set("j-1", {.trace = "1"});
  labels.Set("j-2", {.trace = "2"});
  labels.Set("j-1", {.trace = "3"});
  labels.Set("j-3", {.trace = "4"});
  EXPECT_EQ(labels.Of("j-2"), JobLabel());
  EXPECT_EQ(labels.Of("j-1").trace, "3");
  labels.Set("j-4", {.trace = "5"});
  EXPECT_EQ(labels.Of("j-3"), JobLabel());
  EXPECT_EQ(labels.Of("j-1").trace, "3");
  EXPECT_EQ(labels.Of("j-4").trace, "5");
}

TEST(JobOf, IsTheFieldOrTheFirstWordOfTheUnit) {
  EXPECT_EQ(JobOf(ParseLine("event=e job=j-1 frame=0")), "j-1");
  EXPECT_EQ(JobOf(ParseLine("event=e unit=\"j-2 frame 0\"")), "j-2");
  EXPECT_EQ(JobOf(ParseLine("event=e unit=\"j-2 frame 0\" job=j-1")), "j-1");
  EXPECT_EQ(JobOf(ParseLine("event=e error=\"job=j-1\"")), "");
}

}  // namespace
}  // namespace lumifold::logging
