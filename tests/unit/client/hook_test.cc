#include "client/options/hook.h"

#include <gtest/gtest.h>

#include "tests/unit/client/test_environment.h"

namespace lumifold::client {
namespace {

v1::JobStatus Job() {
  v1::JobStatus job;
  job.set_job_id("j-7");
  job.set_display_name("$(touch stolen); `touch stolen`");
  job.set_state(v1::JOB_STATE_FAILED);
  job.set_error("tile 3: \"NaN\"");
  return job;
}

TEST(Hook, LearnsOfTheJobByItsEnvironment) {
  const ScratchFolder folder;
  Hook hook;
  hook.command =
      "cd " + folder.File("") +
      " && printf '%s|' \"$LUMIFOLD_JOB\" \"$LUMIFOLD_NAME\" \"$LUMIFOLD_STATE\" \"$LUMIFOLD_ERROR\" "
      "\"$LUMIFOLD_OUTPUT\" > facts";
  EXPECT_EQ(hook.Run(Job(), "out.exr"), absl::OkStatus());
  EXPECT_EQ(folder.Read("facts"), "j-7|$(touch stolen); `touch stolen`|failed|tile 3: \"NaN\"|out.exr|");
  EXPECT_EQ(folder.FileCount(), 1);
}

TEST(Hook, ReportsHowItEnded) {
  Hook hook;
  EXPECT_EQ(hook.Run(Job(), ""), absl::OkStatus()) << "there is none";
  hook.command = "exit 3";
  EXPECT_EQ(hook.Run(Job(), ""), absl::InternalError("--hook: ended with code 3"));
  hook.command = "kill -9 $$";
  EXPECT_EQ(hook.Run(Job(), ""), absl::InternalError("--hook: ended by signal 9"));
}

}  // namespace
}  // namespace lumifold::client
