#include "proto/subprocess/child.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <cstdlib>
#include <memory>
#include <string>
#include <thread>

#include "proto/rpc/monotonic.h"

namespace lumifold::subprocess {
namespace {

constexpr size_t kManyBytes = size_t{64} << 20;

ChildOptions Shell(const std::string& command) {
  return {.words = {"sh", "-c", command}, .out = Stream::kPipe, .err = Stream::kPipe};
}

absl::Time In(absl::Duration time) { return rpc::MonotonicNow() + time; }

class ChildTest : public testing::Test {
 protected:
  void Start(const ChildOptions& options) {
    absl::StatusOr<std::unique_ptr<Child>> child = Child::Start(options);
    ASSERT_TRUE(child.ok()) << child.status();
    child_ = *std::move(child);
  }
  Output ReadAll() {
    Output output;
    EXPECT_TRUE(child_->ReadOutput(In(absl::Minutes(5)), kManyBytes, &output));
    return output;
  }
  /// Reads until there is a line.
  std::string ReadLine() {
    Output output;
    while (output.out.find('\n') == std::string::npos)
      EXPECT_FALSE(child_->ReadOutput(In(absl::Milliseconds(20)), kManyBytes, &output));
    return output.out.substr(0, output.out.find('\n'));
  }

  std::unique_ptr<Child> child_;
};

TEST_F(ChildTest, WritesMoreThanPipesHoldToBoth) {
  constexpr size_t kBytes = 300'000;
  Start(Shell("head -c 300000 /dev/zero; head -c 300000 /dev/zero >&2; head -c 300000 /dev/zero"));
  const Output output = ReadAll();
  EXPECT_EQ(output.out.size(), 2 * kBytes);
  EXPECT_EQ(output.err.size(), kBytes);
  EXPECT_EQ(child_->Wait()->code, 0);
}

TEST_F(ChildTest, IsKilledThoughItIgnoresSigterm) {
  Start(Shell("trap '' TERM; echo up; while true; do sleep 1; done"));
  ReadLine();
  EXPECT_EQ(child_->Wait(In(absl::Milliseconds(50))).status().code(), absl::StatusCode::kDeadlineExceeded);
  child_->Kill();
  EXPECT_EQ(child_->Wait()->Text(), "ended by signal 9");
  child_->Kill();  // no effect
}

TEST_F(ChildTest, IsKilledByAnotherThreadWhileItIsWaitedFor) {
  Start(Shell("exec sleep 1000"));
  std::thread killer([this] { child_->Kill(); });
  EXPECT_EQ(child_->Wait()->signal, SIGKILL);
  killer.join();
}

TEST_F(ChildTest, IsKilledWithItsGroup) {
  ChildOptions options = Shell("trap '' TERM; sleep 1000 & echo up; wait");
  options.own_group = true;
  Start(options);
  ReadLine();
  child_->Kill();
  ReadAll();  // the grandchild has the pipes, too: they are closed once it has ended
  EXPECT_EQ(child_->Wait()->signal, SIGKILL);
}

TEST_F(ChildTest, ItsStreamsAreWhatTheOptionsSay) {
  ChildOptions options = Shell("cat; echo err >&2");
  options.in = Stream::kNothing;
  options.out = Stream::kNothing;
  Start(options);
  const Output output = ReadAll();
  EXPECT_EQ(output.out, "");
  EXPECT_EQ(output.err, "err\n");
  EXPECT_EQ(child_->Wait()->code, 0);
}

TEST_F(ChildTest, ItsStandardInputIsTheFileOfTheOptions) {
  const rpc::FileHandle file(open("/proc/self/comm", O_RDONLY | O_CLOEXEC));
  ChildOptions options = Shell("cat");
  options.in = Stream::kFile;
  options.in_file = file.get();
  Start(options);
  EXPECT_EQ(ReadAll().out, "subprocess_test\n");
  EXPECT_EQ(child_->Wait()->code, 0);
}

TEST_F(ChildTest, OutputIsReadUpToALimitOfTimeOrBytes) {
  Start(Shell("exec cat /dev/zero"));
  Output output;
  EXPECT_FALSE(child_->ReadOutput(In(absl::Minutes(5)), 1000, &output));
  EXPECT_GT(output.out.size(), 1000u);
  Start(Shell("exec sleep 1000"));
  const absl::Time start = rpc::MonotonicNow();
  EXPECT_FALSE(child_->ReadOutput(start + absl::Milliseconds(100), kManyBytes, &output));
  EXPECT_GE(rpc::MonotonicNow() - start, absl::Milliseconds(100));
  EXPECT_LT(rpc::MonotonicNow() - start, absl::Seconds(50)) << "these were milliseconds";
}

TEST_F(ChildTest, AValueMayEndWithTheSignOfAPrefix) {
  setenv("LUMIFOLD_TEST_NAME", "old", 1);
  setenv("LUMIFOLD_TEST_OTHER", "kept", 1);
  ChildOptions options = Shell("env | grep ^LUMIFOLD_TEST_ | sort");
  options.environment = {"LUMIFOLD_TEST_NAME=shot*"};
  Start(options);
  EXPECT_EQ(ReadAll().out, "LUMIFOLD_TEST_NAME=shot*\nLUMIFOLD_TEST_OTHER=kept\n");
}

TEST_F(ChildTest, HasNoSignalBlocked) {
  sigset_t blocked;
  sigset_t before;
  sigemptyset(&blocked);
  sigaddset(&blocked, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &blocked, &before);
  Start(Shell("kill -TERM $$; echo alive"));
  pthread_sigmask(SIG_SETMASK, &before, nullptr);
  EXPECT_EQ(ReadAll().out, "");
  EXPECT_EQ(child_->Wait()->signal, SIGTERM);
}

TEST_F(ChildTest, AProgramThatDoesNotExistIsAnErrorForGood) {
  EXPECT_EQ(Child::Start({.words = {"/none/such"}}).status(),
            absl::InternalError("No such file or directory"));
}

TEST_F(ChildTest, TellsHowItEnded) {
  Start(Shell("exit 3"));
  const absl::StatusOr<ExitStatus> exit = child_->Wait(In(absl::Minutes(5)));
  ASSERT_TRUE(exit.ok());
  EXPECT_EQ(exit->Text(), "ended with code 3");
}

}  // namespace
}  // namespace lumifold::subprocess
