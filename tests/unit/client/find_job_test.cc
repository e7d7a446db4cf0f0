#include "client/farm/find_job.h"

#include <gmock/gmock.h>

#include "tests/unit/client/run_client_fixture.h"

namespace lumifold::client {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

/// Jobs are meant by their ids, parts of these, names, and "last".
class FindJobTest : public RunClientTest {
 protected:
  FindJobTest() {
    for (const auto& [id, name] : {std::pair("j-01jaaaaaaaaaaaa1", "room.glb"),
                                   {"j-01jaaaaaaaaaabb2", "shot 7"},
                                   {"j-01jccccccccccbb3", "room.glb"}}) {
      v1::JobStatus& job = farm_.jobs[id];
      job.set_job_id(id);
      job.set_display_name(name);
      job.set_state(v1::JOB_STATE_PAUSED);
    }
  }
  /// The id that a command asks for.
  std::string Found(const std::string& name) {
    test_.out.str("");
    if (Run({"status", name, "--json"}) != 0) return "";
    const std::string out = Out();
    const size_t at = out.find("j-");
    return out.substr(at, out.find('"', at) - at);
  }
};

TEST_F(FindJobTest, ByIdOrAPartOfItThatNoOtherHas) {
  for (const char* name : {"j-01jaaaaaaaaaabb2", "j-01jaaaaaaaaaab", "abb2", "shot 7"})
    EXPECT_EQ(Found(name), "j-01jaaaaaaaaaabb2") << name << Err();
  EXPECT_EQ(Found("j-01jc"), "j-01jccccccccccbb3");
  EXPECT_EQ(Found("cbb3"), "j-01jccccccccccbb3");
}

TEST_F(FindJobTest, SaysWhichJobsAreMeantAndChangesNone) {
  EXPECT_EQ(Run({"delete", "j-01ja"}), 2);
  EXPECT_THAT(Err(), HasSubstr("'j-01ja' means 2 jobs: j-01jaaaaaaaaaaaa1, j-01jaaaaaaaaaabb2\n"));
  EXPECT_EQ(Run({"cancel", "room.glb"}), 2);
  EXPECT_THAT(Err(), HasSubstr("'room.glb' means 2 jobs: j-01jaaaaaaaaaaaa1, j-01jccccccccccbb3\n"));
  EXPECT_EQ(Run({"cancel", "j-9"}), 4);
  EXPECT_EQ(Run({"cancel", ""}), 2);
  EXPECT_THAT(farm_.cancelled(), ElementsAre());
}

TEST_F(FindJobTest, TheLastOneIsOfTheUser) {
  test_.environment.defaults.user = "ann";
  EXPECT_EQ(Found("last"), "j-01jaaaaaaaaaaaa1") << "the farm lists them newest first";
  EXPECT_THAT(farm_.calls(), ElementsAre(R"(ListJobs limit: 1 user: "ann")"));
  farm_.jobs.clear();
  EXPECT_EQ(Run({"status", "last"}), 4);
  EXPECT_THAT(Err(), HasSubstr("there is no job of user 'ann'"));
}

TEST_F(FindJobTest, AWholeIdNeedsNoSearch) {
  EXPECT_EQ(Run({"cancel", "j-01jaaaaaaaaaabb2"}), 0);
  EXPECT_THAT(farm_.calls(), ElementsAre());
}

TEST_F(FindJobTest, OfPagesWithoutEnd) {
  farm_.page_jobs = 1;
  EXPECT_EQ(Found("abb2"), "j-01jaaaaaaaaaabb2");
}

TEST_F(FindJobTest, OtherCommandsTakeNamesToo) {
  farm_.watched = {Job(v1::JOB_STATE_DONE)};
  EXPECT_EQ(Run({"add-samples", "abb2", "64"}), 0);
  EXPECT_EQ(Run({"logs", "last"}), 0);
  EXPECT_EQ(Run({"submit", scene_, "--after", "abb2"}), 0) << Err();
  EXPECT_THAT(farm_.submissions().back().scheduling().after(), ElementsAre("j-01jaaaaaaaaaabb2"));
  EXPECT_EQ(Run({"submit", scene_, "--after", "j-9"}), 4);
  EXPECT_THAT(farm_.calls(), testing::Contains(R"(GetLog job_id: "j-01jaaaaaaaaaaaa1" limit: 100)"));
}

}  // namespace
}  // namespace lumifold::client
