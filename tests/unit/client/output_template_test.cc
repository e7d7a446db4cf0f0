#include "client/pictures/output_template.h"

#include <gtest/gtest.h>

namespace lumifold::client {
namespace {

v1::JobStatus Job(const std::string& name) {
  v1::JobStatus job;
  job.set_job_id("j-7");
  job.set_display_name(name);
  job.mutable_scheduling()->set_user("ann");
  return job;
}

TEST(OutputTemplate, HasTheNamesOfTheJobAndTheNumberOfTheFrame) {
  EXPECT_EQ(PathOfOutput("shots/{user}/{name}-{job}.####.exr", Job("room"), 12),
            "shots/ann/room-j-7.0012.exr");
  EXPECT_EQ(PathOfOutput("out.exr", Job("room"), 12), "out.exr");
}

TEST(OutputTemplate, ANameCannotLeadElsewhere) {
  EXPECT_EQ(PathOfOutput("{name}.exr", Job("../../etc/passwd"), 0), "_._.._etc_passwd.exr");
  EXPECT_EQ(PathOfOutput("{name}.exr", Job("a\nb#"), 5), "a_b_.exr");
  EXPECT_EQ(PathOfOutput("{name}.exr", Job("{job}{user}"), 0), "{job}ann.exr")
      << "a value is not looked at again";
}

TEST(OutputTemplate, OtherPlaceholdersAreRefused) {
  EXPECT_TRUE(CheckTemplate("{name}/{job}.{user}.#.exr").ok());
  for (const char* path : {"{frame}.exr", "{name.exr", "name}.exr", "{}.exr", "{{name}}.exr"})
    EXPECT_TRUE(absl::IsInvalidArgument(CheckTemplate(path))) << path;
}

TEST(OutputTemplate, KnowsWhatIsThereBeforeTheJob) {
  EXPECT_EQ(KnownFolderOf("shots/a/{user}/x.exr"), "shots/a");
  EXPECT_EQ(KnownFolderOf("shots/a/x{user}.exr"), "shots/a");
  EXPECT_EQ(KnownFolderOf("{user}/x.exr"), "");
  EXPECT_TRUE(NeedsJob("{job}.exr"));
  EXPECT_FALSE(NeedsJob("a.exr"));
}

}  // namespace
}  // namespace lumifold::client
