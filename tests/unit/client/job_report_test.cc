#include "client/reports/job_report.h"

#include <gtest/gtest.h>

namespace lumifold::client {
namespace {

v1::JobStatus SampleJob() {
  v1::JobStatus job;
  job.set_job_id("j7");
  job.set_state(v1::JOB_STATE_RUNNING);
  job.set_display_name("room \"A\".glb");
  job.add_warnings("no light");
  job.set_submitted_unix_ms(1'700'000'000'000);
  job.set_workers(3);
  job.set_units_done(5);
  job.set_units_total(20);
  job.set_frames_total(1);
  job.set_samples_done(1000);
  job.set_samples_total(4000);
  job.mutable_times()->set_render_seconds(1.5);
  job.mutable_scheduling()->set_user("ann");
  job.mutable_scheduling()->set_priority(5);
  job.mutable_scheduling()->add_tags("gpu");
  return job;
}

TEST(JobJson, HasEveryFieldInAStableOrder) {
  EXPECT_EQ(
      JobJson(SampleJob(), {{"output", "a.exr"}}),
      R"({"schema_version":1,"job_id":"j7","state":"running","name":"room \"A\".glb","error":"","warnings":["no light"],)"
      R"("submitted_unix_ms":1700000000000,"workers":3,"units_done":5,"units_total":20,"frames_done":0,)"
      R"("frames_total":1,"samples_done":1000,"samples_total":4000,"bad_samples":0,"render_seconds":1.5,)"
      R"("assemble_seconds":0.0,"filter_seconds":0.0,"write_seconds":0.0,"user":"ann","priority":5,"tags":["gpu"],)"
      R"("max_leases":0,"after":[],"class":"","audit_share":0.0,"output":"a.exr"})");
}

TEST(JobJson, ReplacesBytesThatAreNoText) {
  v1::JobStatus job;
  const std::string json = JobJson(job, {{"output", "a\xff.exr"}});
  EXPECT_NE(json.find("\"output\":\"a\xEF\xBF\xBD.exr\""), std::string::npos) << json;
}

TEST(JobText, NamesEachThingOnALine) {
  EXPECT_EQ(
      JobText(SampleJob()),
      "job: j7\nstate: running\nscene: room \"A\".glb\nwarning: no light\nsubmitted: 2023-11-14T22:13:20Z\n"
      "user: ann\npriority: 5\ntags: gpu\nworkers: 3\nunits: 5 of 20\nframes: 0 of 1\nsamples: 1000 of 4000\n"
      "stages: render 1.50 s, assemble 0.00 s, filter 0.00 s, write 0.00 s\n");
}

TEST(JobReport, TellsWhichFramesAreInTheFilter) {
  v1::JobStatus job = SampleJob();
  EXPECT_EQ(FilteringText(job), "");
  job.set_frames_filtering(2);
  EXPECT_NE(JobText(job).find("\nframes: 0 of 1, 2 in the filter\n"), std::string::npos) << JobText(job);
  job.set_frames_waiting(4);
  EXPECT_NE(JobText(job).find("\nframes: 0 of 1, 2 in the filter, 4 waiting\n"), std::string::npos);
  EXPECT_NE(JobJson(job, {}).find(R"("frames_total":1,"frames_filtering":2,"frames_waiting":4,)"),
            std::string::npos);
}

TEST(JobReport, NamesTheCoordinatorOfAFarmOfSeveral) {
  v1::JobStatus job = SampleJob();
  job.set_coordinator("rack-2");
  EXPECT_NE(JobText(job).find("\ncoordinator: rack-2\n"), std::string::npos);
  EXPECT_NE(JobJson(job, {}).find(R"("audit_share":0.0,"coordinator":"rack-2"})"), std::string::npos);
}

TEST(JobReport, SaysWhichFramesAreSkipped) {
  v1::JobStatus job = SampleJob();
  job.set_state(v1::JOB_STATE_DONE_WITH_GAPS);
  job.set_frames_skipped(3);
  EXPECT_EQ(JobJson(job, {}).find(R"("skipped")"), std::string::npos) << "of a list";
  v1::FrameRange* const range = job.mutable_scheduling()->mutable_gaps()->add_skipped();
  range->set_first(7);
  range->set_count(2);
  job.mutable_scheduling()->mutable_gaps()->add_skipped()->set_count(1);
  job.mutable_scheduling()->mutable_gaps()->mutable_skipped(1)->set_first(12);
  EXPECT_NE(JobText(job).find("\nstate: done-with-gaps\n"), std::string::npos);
  EXPECT_NE(JobText(job).find("\nskipped: 7-8,12\n"), std::string::npos);
  EXPECT_NE(JobJson(job, {}).find(R"("frames_skipped":3,"skipped":"7-8,12",)"), std::string::npos);
}

TEST(JobTable, LinesUpUnderItsHead) {
  EXPECT_EQ(JobTableHead(),
            "JOB                  STATE           DONE  SUBMITTED            USER         SCENE\n");
  EXPECT_EQ(JobTableLine(SampleJob()),
            "j7                   running          25%  2023-11-14T22:13:20Z ann          room \"A\".glb\n");
}

TEST(Fate, IsTheExitCode) {
  v1::JobStatus job;
  for (const auto& [state, code, ended] : {std::tuple{v1::JOB_STATE_PLANNED, ExitCode::kOk, false},
                                           std::tuple{v1::JOB_STATE_RUNNING, ExitCode::kOk, false},
                                           std::tuple{v1::JOB_STATE_FILTERING, ExitCode::kOk, false},
                                           std::tuple{v1::JOB_STATE_DONE, ExitCode::kOk, true},
                                           std::tuple{v1::JOB_STATE_DONE_WITH_GAPS, ExitCode::kGaps, true},
                                           std::tuple{v1::JOB_STATE_FAILED, ExitCode::kFailed, true},
                                           std::tuple{v1::JOB_STATE_CANCELLED, ExitCode::kCancelled, true}}) {
    job.set_state(state);
    EXPECT_EQ(ExitCodeForOutcome(job), code);
    EXPECT_EQ(HasEnded(job), ended);
  }
}

TEST(StateName, KnowsThatItDoesNotKnow) { EXPECT_EQ(StateName(static_cast<v1::JobState>(99)), "unknown"); }

}  // namespace
}  // namespace lumifold::client
