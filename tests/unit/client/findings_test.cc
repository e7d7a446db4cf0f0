#include "client/reports/findings.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "proto/rpc/version.h"

namespace lumifold::client {
namespace {

using Level = Finding::Level;
using ::testing::HasSubstr;

constexpr uint64_t kPlenty = uint64_t{1} << 40;

Level WorstOf(const Findings& findings) {
  Level worst = Level::kOk;
  for (const Finding& finding : findings) worst = std::max(worst, finding.level);
  return worst;
}

TEST(Findings, AboutTheMachine) {
  const MachineFacts good = {"/tmp", "", kPlenty, kPlenty, 1024};
  EXPECT_EQ(WorstOf(AboutMachine(good)), Level::kOk);
  MachineFacts facts = good;
  facts.temporary_error = "Read-only file system";
  EXPECT_EQ(AboutMachine(facts)[0].level, Level::kWrong);
  EXPECT_THAT(AboutMachine(facts)[0].text, HasSubstr("/tmp: Read-only"));
  for (uint64_t MachineFacts::* const member :
       {&MachineFacts::free_bytes, &MachineFacts::available_memory_bytes, &MachineFacts::open_files}) {
    facts = good;
    facts.*member = 10;
    EXPECT_EQ(WorstOf(AboutMachine(facts)), Level::kWarning);
  }
}

TEST(Findings, AboutDevices) {
  EXPECT_THAT(AboutDevices(absl::NotFoundError("there is no libOpenCL.so.1"))[0].text,
              HasSubstr("the processor filters: there is no libOpenCL.so.1"));
  EXPECT_EQ(WorstOf(AboutDevices(std::vector<DeviceFacts>())), Level::kOk);
  const std::vector<DeviceFacts> devices = {
      {"Good GPU", "OpenCL 3.0", true, kPlenty, "", ""},
      {"Processor", "OpenCL 3.0", false, kPlenty, "", ""},
      {"Small GPU", "OpenCL 1.2", true, kPlenty, "it has no compiler", ""},
      {"Other GPU", "OpenCL 1.2", true, kPlenty, "", "it has no denormal numbers"}};
  const Findings findings = AboutDevices(devices);
  ASSERT_EQ(findings.size(), 4u);
  EXPECT_EQ(findings[0].text, "gpu:0 is Good GPU, 1099.5 GB, OpenCL 3.0: filters");
  EXPECT_THAT(findings[1].text, HasSubstr("gpu:1 is Processor, no GPU"));
  EXPECT_EQ(findings[2].level, Level::kNote);
  EXPECT_THAT(findings[2].text, HasSubstr("does not filter: it has no compiler"));
  EXPECT_THAT(findings[3].text,
              HasSubstr("filters with --allow-other-bits alone: it has no denormal numbers"));
}

TEST(Findings, AboutPrograms) {
  const std::string ours = "lumifold-worker " + std::string(rpc::kVersion);
  EXPECT_EQ(AboutProgram("lumifold-worker", ours).level, Level::kOk);
  EXPECT_EQ(AboutProgram("lumifold-worker", ours + " (numeric class x)").level, Level::kOk);
  EXPECT_EQ(AboutProgram("lumifold-worker", "lumifold-worker 0.0.1").level, Level::kWarning);
  EXPECT_EQ(AboutProgram("lumifold-worker", absl::NotFoundError("")).level, Level::kNote);
  EXPECT_EQ(AboutProgram("lumifold-worker", absl::InternalError("libembree4.so: not found")).level,
            Level::kWrong);
}

TEST(Findings, AboutProfiles) {
  const absl::Time now = absl::UnixEpoch() + absl::Hours(24 * 365);
  EXPECT_EQ(AboutProfile("p", absl::InfiniteFuture(), now).level, Level::kOk);
  EXPECT_EQ(AboutProfile("p", now + absl::Hours(24 * 30), now).level, Level::kOk);
  EXPECT_EQ(AboutProfile("p", now + absl::Hours(24), now).level, Level::kWarning);
  EXPECT_EQ(AboutProfile("p", now, now).level, Level::kWrong);
  EXPECT_EQ(AboutProfile("p", absl::FailedPreconditionError("others can read it"), now).level, Level::kWrong);
}

TEST(Findings, AboutCoordinators) {
  v1::ServerStatus status;
  status.set_version(std::string(rpc::kVersion));
  status.set_free_bytes(kPlenty);
  EXPECT_EQ(WorstOf(AboutCoordinator("a:1", true, status)), Level::kOk);
  status.set_insecure(true);
  EXPECT_EQ(WorstOf(AboutCoordinator("a:1", true, status)), Level::kNote);
  status.set_free_bytes(1);
  EXPECT_EQ(WorstOf(AboutCoordinator("a:1", true, status)), Level::kWarning);
  status.set_storage_error("no space left on device");
  EXPECT_EQ(WorstOf(AboutCoordinator("a:1", true, status)), Level::kWrong);
  status.set_version("0.0.1");
  EXPECT_EQ(AboutCoordinator("a:1", true, status)[0].level, Level::kWarning);
  const absl::Status down = absl::UnavailableError("cannot reach the coordinator at a:1");
  EXPECT_EQ(WorstOf(AboutCoordinator("a:1", true, down)), Level::kWrong);
  EXPECT_EQ(WorstOf(AboutCoordinator("a:1", false, down)), Level::kNote) << "nobody asked for it";
}

TEST(Findings, AboutWhoeverAsks) {
  v1::WhoAmIResponse caller;
  caller.set_name("ann");
  caller.add_scopes(v1::ACCESS_SCOPE_READ);
  EXPECT_EQ(AboutIdentity(caller).level, Level::kWarning);
  caller.add_scopes(v1::ACCESS_SCOPE_SUBMIT);
  EXPECT_EQ(AboutIdentity(caller).level, Level::kOk);
  EXPECT_EQ(AboutIdentity(absl::UnauthenticatedError("who are you")).level, Level::kWrong);
}

TEST(Findings, AboutWorkers) {
  std::vector<v1::WorkerStatus> workers;
  EXPECT_EQ(WorstOf(AboutWorkers(workers)), Level::kWrong);
  workers.resize(2);
  workers[0].set_state(v1::WORKER_STATE_BUSY);
  workers[0].set_numeric_class("a");
  workers[1] = workers[0];
  EXPECT_EQ(WorstOf(AboutWorkers(workers)), Level::kOk);
  workers[1].set_numeric_class("b");
  EXPECT_EQ(WorstOf(AboutWorkers(workers)), Level::kNote);
  workers[1].set_name("node:7");
  workers[1].set_state(v1::WORKER_STATE_SET_ASIDE);
  workers[1].set_reason("3 units failed");
  const Findings findings = AboutWorkers(workers);
  EXPECT_EQ(WorstOf(findings), Level::kWarning);
  EXPECT_THAT(findings[0].text, HasSubstr("node:7 is set aside: 3 units failed"));
}

TEST(Findings, AreLinesAndObjects) {
  const Finding finding = {Level::kWarning, "workers", "none", "start one"};
  EXPECT_EQ(FindingText(finding), "warning  workers: none\n         -> start one\n");
  EXPECT_EQ(FindingText(finding, true), "\x1b[33mwarning \x1b[0m workers: none\n         -> start one\n");
  EXPECT_EQ(
      FindingJson(finding),
      R"({"schema_version":1,"level":"warning","subject":"workers","text":"none","advice":"start one"})");
}

}  // namespace
}  // namespace lumifold::client
