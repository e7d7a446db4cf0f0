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

TEST(JobJson, ReplacesBytesThatAreNoText) {
  v1::JobStatus job;
  const std::string json = JobJson(job, {{"output", "a\xff.exr"}});
  EXPECT_NE(json.find("\"output\":\"a\xEF\xBF\xBD.exr\""), std::string::npos) << json;
}

TEST(JobReport, TellsWhichFramesAreInTheFilter) {
  v1::JobStatus job = SampleJob();
  EXPECT_EQ(FilteringText(job), "");
  job.set_frames_filtering(2);
  job.set_frames_filtered(1.5);
  EXPECT_NE(JobText(job).find("\nframes: 0 of 1, 2 in the filter\n"), std::string::npos) << JobText(job);
  job.set_frames_waiting(4);
  EXPECT_NE(JobText(job).find("\nframes: 0 of 1, 2 in the filter, 4 waiting\n"), std::string::npos);
  EXPECT_NE(JobJson(job, {}).find(
                R"("frames_total":1,"frames_filtering":2,"frames_filtered":1.5,"frames_waiting":4,)"),
            std::string::npos);
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

TEST(JobReport, SaysHowFarTheCallOfAWebhookIs) {
  v1::JobStatus job = SampleJob();
  EXPECT_EQ(JobJson(job).find("webhook"), std::string::npos);
  job.mutable_scheduling()->set_webhook("https://a.example/");
  EXPECT_NE(JobText(job).find("\nwebhook: https://a.example/\n"), std::string::npos);
  job.mutable_webhook()->set_state(v1::WebhookDelivery::STATE_WAITING);
  job.mutable_webhook()->set_tries(3);
  job.mutable_webhook()->set_error("answered with 500");
  EXPECT_NE(
      JobText(job).find("\nwebhook: https://a.example/, waiting, tries 3, last failure: answered with 500\n"),
      std::string::npos);
  EXPECT_NE(JobJson(job).find(R"("webhook":{"url":"https://a.example/","state":"waiting",)"),
            std::string::npos);
}

TEST(JobTable, LinesUpUnderItsHead) {
  EXPECT_EQ(JobTableHead(),
            "JOB                  STATE           DONE  SUBMITTED                TIME  USER         NAME\n");
  v1::JobStatus job = SampleJob();
  EXPECT_EQ(JobTableLine(job),
            "j7                   running          25%  2023-11-14T22:13:20Z       2s  ann          room "
            "\"A\".glb\n");
  job.set_state(v1::JOB_STATE_FAILED);
  job.set_error("no mesh\nat all");
  job.mutable_times()->clear_render_seconds();
  EXPECT_EQ(JobTableLine(job),
            "j7                   failed           25%  2023-11-14T22:13:20Z        -  ann          room "
            "\"A\".glb  "
            "error: no mesh\\nat all\n");
}

TEST(JobReport, OptionsAreAsTheyWereWritten) {
  v1::JobStatus job;
  v1::JobSpec& settings = *job.mutable_settings();
  settings.mutable_environment()->set_uri("environment:sky.exr");
  settings.mutable_environment()->set_scale(0.1f);
  settings.mutable_lens()->set_f_stop(2.8f);
  EXPECT_NE(JobText(job).find(" --env sky.exr --env-rotate 0.0 --env-scale 0.1 --f-stop 2.8 "),
            std::string::npos)
      << JobText(job);
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
