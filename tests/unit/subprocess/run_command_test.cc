#include "proto/subprocess/run_command.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>

namespace lumifold::subprocess {
namespace {

using testing::HasSubstr;

constexpr absl::Duration kLong = absl::Minutes(5);

TEST(RunCommand, GivesOutputErrorsAndExitCode) {
  const auto done = RunCommand({"sh", "-c", "echo out; echo err >&2; exit 3"}, {}, kLong);
  ASSERT_TRUE(done.ok()) << done.status();
  EXPECT_EQ(done->out, "out\n");
  EXPECT_EQ(done->err, "err\n");
  EXPECT_EQ(done->exit_code, 3);
}

TEST(RunCommand, PassesArgumentsWithoutAShell) {
  const auto done = RunCommand({"printf", "%s", "$HOME; `id`"}, {}, kLong);
  ASSERT_TRUE(done.ok());
  EXPECT_EQ(done->out, "$HOME; `id`");
}

TEST(RunCommand, ChangesTheEnvironment) {
  setenv("LUMIFOLD_TEST_A", "a", 1);
  setenv("LUMIFOLD_TEST_B", "b", 1);
  setenv("LUMIFOLD_TEST", "c", 1);
  const auto done = RunCommand({"sh", "-c", "echo \"$LUMIFOLD_TEST_A,$LUMIFOLD_TEST_B,$LUMIFOLD_TEST,$TZ\""},
                               {"LUMIFOLD_TEST_*", "LUMIFOLD_TEST", "TZ=UTC"}, kLong);
  ASSERT_TRUE(done.ok());
  EXPECT_EQ(done->out, ",,,UTC\n");
}

TEST(RunCommand, KillsWhatTakesTooLongWithItsChildren) {
  // The child keeps the output open.
  const auto done = RunCommand({"sh", "-c", "sleep 1000 & sleep 1000"}, {}, absl::Milliseconds(300));
  EXPECT_EQ(done.status().code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(done.status().message()), HasSubstr("sh took longer than 300ms"));
}

TEST(RunCommand, NamesAProgramThatDoesNotExistAndASignal) {
  EXPECT_THAT(std::string(RunCommand({"no-such-program"}, {}, kLong).status().message()),
              HasSubstr("cannot run no-such-program"));
  EXPECT_THAT(std::string(RunCommand({"sh", "-c", "kill -9 $$"}, {}, kLong).status().message()),
              HasSubstr("ended by signal 9"));
}

TEST(RunCommand, StopsAtTooMuchOutput) {
  EXPECT_EQ(RunCommand({"cat", "/dev/zero"}, {}, kLong).status().code(), absl::StatusCode::kUnavailable);
}

}  // namespace
}  // namespace lumifold::subprocess
