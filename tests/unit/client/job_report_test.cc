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
      R"({"schema_version":1,"job_id":"j7","state":"running","name":"room \"A\".glb","error":"",)"
      R"("warnings":["no light"],"submitted_unix_ms":1700000000000,"workers":3,"units_done":5,)"
      R"("units_total":20,"frames_done":0,"frames_total":1,"samples_done":1000,"samples_total":4000,"bad_samples":0,"render_seconds":1.5,)"
      R"("assemble_seconds":0.0,"filter_seconds":0.0,"write_seconds":0.0,"user":"ann","priority":5,)"
      R"("tags":["gpu"],"max_leases":0,"after":[],"class":"","audit_share":0.0,"output":"a.exr"})");
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

TEST(JobReport, SaysWithWhichOptionsAJobWasSubmitted) {
  v1::JobStatus job = SampleJob();
  EXPECT_EQ(JobJson(job).find("options"), std::string::npos) << "of a list";
  job.set_width(64);
  job.set_height(48);
  job.set_samples_per_pixel(256);
  job.set_first_frame(1);
  job.set_frame_count(48);
  v1::FrameRange* const more = job.add_more_frames();
  more->set_first(60);
  more->set_count(1);
  job.mutable_adaptive()->set_target_error(0.5);
  v1::JobSpec& settings = *job.mutable_settings();
  settings.set_camera("front door");
  settings.set_frames_per_second(24);
  settings.set_max_bounces(8);
  settings.mutable_filter()->set_method("default");
  settings.mutable_crop()->set_frame_width(1920);
  settings.mutable_crop()->set_frame_height(1080);
  settings.mutable_crop()->set_x(100);
  settings.mutable_environment()->set_uri("environment:sky.exr");
  settings.mutable_environment()->set_scale(0.1f);
  settings.mutable_lens()->set_f_stop(2.8f);
  settings.set_background(v1::BACKGROUND_TRANSPARENT);
  settings.set_ground(v1::GROUND_SHADOW);
  settings.set_cryptomatte(true);
  settings.mutable_planning()->add_forced("levels=2");
  settings.mutable_planning()->add_forced("glossy=1");
  EXPECT_NE(JobJson(job).find(
                R"("width":64,"height":48,"samples_per_pixel":256,"options":{"size":"1920x1080",)"
                R"("region":"100,0,164,48","frames":"1-48,60","fps":24.0,"spp":256,"adaptive":true,)"
                R"("target-error":0.5,"target-metric":"mse255","seed":0,"max-bounces":8,"method":"default",)"
                R"("camera":"front door","env":"sky.exr","env-rotate":0.0,"env-scale":0.1,)"
                R"("background":"transparent","ground":"shadow","f-stop":2.8,"focus":0.0,"cryptomatte":true,)"
                R"("force":["levels=2","glossy=1"]})"),
            std::string::npos)
      << JobJson(job);
  EXPECT_NE(
      JobText(job).find("\nsize: 64x48\nsamples per pixel: 256\noptions: --region 100,0,164,48 --fps 24.0 "
                        "--adaptive --target-error 0.5 "),
      std::string::npos)
      << JobText(job);
  EXPECT_NE(JobText(job).find(" --camera \"front door\" "), std::string::npos);
  EXPECT_NE(JobText(job).find(" --cryptomatte --force levels=2 --force glossy=1\n"), std::string::npos);
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
