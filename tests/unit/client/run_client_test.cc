#include "client/commands/run_client.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "tests/unit/client/run_client_fixture.h"

namespace lumifold::client {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::StartsWith;

TEST_F(RunClientTest, RefusesOutputsBeforeAnyWork) {
  EXPECT_EQ(Run({"render", scene_, "-o", "out.gif"}), 2);
  EXPECT_EQ(Run({"render", scene_, "-o", folder_.File("none/out.exr")}), 4);
  EXPECT_EQ(Run({"render", scene_, "-o", "out.exr", "--noisy", "noisy.exr"}), 2);
  EXPECT_THAT(local_options_, testing::IsEmpty());
  EXPECT_EQ(Out(), "");
}

TEST_F(RunClientTest, SaysThatAFarmCannotStart) {
  test_.environment.local.farm = [](const LocalFarmOptions&) {
    return absl::InternalError("no room on the disk");
  };
  EXPECT_EQ(Run({"render", scene_, "-o", folder_.File("out.exr")}), 1);
  EXPECT_EQ(Err(), "lumifold: no room on the disk\n");
}

TEST_F(RunClientTest, SaysWhatTheCoordinatorRefuses) {
  farm_.submit_error = "filter.method: no method 'best'";
  EXPECT_EQ(Run({"submit", scene_, "--method", "best"}), 2);
  EXPECT_THAT(Err(), testing::EndsWith("lumifold: filter.method: no method 'best'\n"));
}

TEST_F(RunClientTest, PrintsTheIdOfASubmittedJobAlone) {
  EXPECT_EQ(
      Run({"submit", scene_, "--size", "512x384", "--spp", "16", "--seed", "18446744073709551615", "--camera",
           "left", "--max-bounces", "3", "--method", "none", "--frame", "7", "--save-film"}),
      0);
  EXPECT_EQ(Out(), "job-1\n");
  ASSERT_EQ(farm_.submissions().size(), 1u);
  const v1::JobSpec spec = farm_.submissions()[0].spec();
  EXPECT_EQ(spec.width(), 512);
  EXPECT_EQ(spec.height(), 384);
  EXPECT_EQ(spec.samples_per_pixel(), 16);
  EXPECT_EQ(spec.seed(), 18446744073709551615u);
  EXPECT_EQ(spec.camera(), "left");
  EXPECT_EQ(spec.max_bounces(), 3);
  EXPECT_EQ(spec.filter().method(), "none");
  EXPECT_EQ(spec.first_frame(), 7);
  EXPECT_EQ(spec.frame_count(), 1);
  EXPECT_TRUE(spec.save_film());
  EXPECT_EQ(spec.pass_samples(), 0);  // the coordinator chooses
  EXPECT_EQ(spec.tile_size(), 0);
  EXPECT_EQ(spec.scene().display_name(), "room.gltf");
  EXPECT_EQ(spec.scene().dependencies(0).uri(), "mesh.bin");
  EXPECT_EQ(farm_.submissions()[0].request_id().size(), 32u);
}

TEST_F(RunClientTest, UploadsNothingOfASceneThatAWorkerWouldRefuse) {
  test_.environment.local.scene_check = [](const v1::JobSpec& spec, const SceneAssets& assets) {
    EXPECT_EQ(assets.size(), 2u);
    EXPECT_EQ(spec.scene().display_name(), "room.gltf");
    return spec.camera() == "top" ? absl::NotFoundError("room.gltf: no camera 'top'")
                                  : absl::InvalidArgumentError("room.gltf: needs EXT_new");
  };
  EXPECT_EQ(Run({"submit", scene_, "--camera", "top"}), 4);
  EXPECT_EQ(Run({"submit", scene_}), 1);
  EXPECT_EQ(Err(), "lumifold: room.gltf: no camera 'top'\nlumifold: room.gltf: needs EXT_new\n");
  EXPECT_THAT(farm_.uploads(), IsEmpty());
  EXPECT_THAT(farm_.submissions(), IsEmpty());
  EXPECT_EQ(Run({"submit", scene_, "--unchecked"}), 0) << Err();
}

TEST_F(RunClientTest, SendsTheHeightOfTheCamera) {
  constexpr char kTall[] = R"({"asset":{"version":"2.0"},"nodes":[{"camera":0}],"cameras":[
      {"type":"perspective","perspective":{"yfov":1,"aspectRatio":0.75}}]})";
  const std::string tall = folder_.Write("tall.gltf", kTall);
  EXPECT_EQ(Run({"submit", tall, "--size", "300", "--region", "0,0,300,400"}), 0);
  EXPECT_EQ(Run({"submit", scene_, "--size", "512"}), 0);
  EXPECT_EQ(farm_.submissions()[0].spec().crop().frame_height(), 400);
  EXPECT_EQ(farm_.submissions()[1].spec().height(), 384);
  EXPECT_EQ(Run({"submit", tall, "--size", "16000"}), 2);
  EXPECT_THAT(Err(), HasSubstr("would be higher than 16384"));
  EXPECT_EQ(Run({"submit", folder_.File("none.glb"), "--size", "512"}), 4);
}

TEST_F(RunClientTest, SendsBackgroundAndGround) {
  EXPECT_EQ(Run({"submit", scene_, "--ground", "shadow"}), 0);
  EXPECT_EQ(Run({"submit", scene_, "--background", "transparent"}), 0);
  EXPECT_EQ(Run({"submit", scene_, "--background", "environment", "--ground", "none"}), 0);
  const auto spec = [&](size_t i) { return farm_.submissions()[i].spec(); };
  EXPECT_EQ(spec(0).ground(), v1::GROUND_SHADOW);
  EXPECT_EQ(spec(0).background(), v1::BACKGROUND_TRANSPARENT);
  EXPECT_EQ(spec(1).ground(), v1::GROUND_NONE);
  EXPECT_EQ(spec(1).background(), v1::BACKGROUND_TRANSPARENT);
  EXPECT_EQ(spec(2).background(), v1::BACKGROUND_ENVIRONMENT);
  EXPECT_EQ(Run({"submit", scene_, "--background", "green"}), 2);
}

TEST_F(RunClientTest, SendsTheFramesAndTheirSpeed) {
  EXPECT_EQ(Run({"submit", scene_, "--frames", "3-5", "--fps", "12.5"}), 0);
  EXPECT_EQ(Run({"submit", scene_}), 0);
  const v1::JobSpec several = farm_.submissions()[0].spec();
  EXPECT_EQ(several.first_frame(), 3);
  EXPECT_EQ(several.frame_count(), 3);
  EXPECT_EQ(several.frames_per_second(), 12.5);
  const v1::JobSpec one = farm_.submissions()[1].spec();
  EXPECT_EQ(one.first_frame(), 0);
  EXPECT_EQ(one.frame_count(), 1);
  EXPECT_EQ(one.frames_per_second(), 24);
}

TEST_F(RunClientTest, SendsFramesWithGaps) {
  EXPECT_EQ(Run({"submit", scene_, "--frames", "3-5,8,10-11"}), 0);
  const v1::JobSpec spec = farm_.submissions()[0].spec();
  EXPECT_EQ(spec.first_frame(), 3);
  EXPECT_EQ(spec.frame_count(), 3);
  ASSERT_EQ(spec.more_frames_size(), 2);
  EXPECT_EQ(spec.more_frames(0).first(), 8);
  EXPECT_EQ(spec.more_frames(0).count(), 1);
  EXPECT_EQ(spec.more_frames(1).first(), 10);
  EXPECT_EQ(spec.more_frames(1).count(), 2);
}

TEST_F(RunClientTest, RefusesSeveralFramesInOneFile) {
  EXPECT_EQ(Run({"render", scene_, "-o", folder_.File("out.exr"), "--frames", "1-2"}), 2);
  EXPECT_THAT(Err(), HasSubstr("-o: expected a name with ### for the frame's number; got '"));
  EXPECT_EQ(
      Run({"download", "job-1", "-o", folder_.File("#.png"), "--noisy", "noisy.png", "--frames", "1-2"}), 2);
  EXPECT_THAT(Err(), HasSubstr("--noisy: expected a name with ###"));
  EXPECT_THAT(local_options_, testing::IsEmpty());
}

TEST_F(RunClientTest, RendersAFileAFrame) {
  EXPECT_EQ(Run({"render", scene_, "--reproducible", "-o", folder_.File("a.##.exr"), "--noisy",
                 folder_.File("n#.png"), "--frames", "9-10", "--json"}),
            0)
      << Err();
  EXPECT_EQ(folder_.Read("a.09.exr"), farm_.result);
  EXPECT_EQ(folder_.Read("a.10.exr"), farm_.result);
  EXPECT_EQ(folder_.FileCount(), 7);  // room.gltf, mesh.bin, result; a.09.exr, a.10.exr, n9.png, n10.png
  EXPECT_THAT(Out(), HasSubstr(R"("output":")" + folder_.File("a.##.exr") + '"'));
  EXPECT_THAT(Err(), HasSubstr("wrote " + folder_.File("a.09.exr") + " to " + folder_.File("a.10.exr")));
}

TEST_F(RunClientTest, DownloadsAFileAFrame) {
  farm_.jobs = {{"job-1", Job(v1::JOB_STATE_DONE)}};
  EXPECT_EQ(
      Run({"download", "job-1", "-o", folder_.File("a#.exr"), "--frames", "0-1", "--json", "--reproducible"}),
      0)
      << Err();
  EXPECT_EQ(folder_.Read("a0.exr"), farm_.result);
  EXPECT_EQ(folder_.FileCount(), 5);
  EXPECT_THAT(Out(), testing::EndsWith(R"("frame":1,"output":")" + folder_.File("a1.exr") + "\"}\n"));
}

TEST_F(RunClientTest, SendsTheEnvironmentAndTheLens) {
  const std::string sky = folder_.Write("sky.exr", "light");
  EXPECT_EQ(Run({"submit", scene_, "--env", sky, "--env-rotate", "-90", "--env-scale", "0.5", "--f-stop",
                 "2.8", "--focus", "3"}),
            0);
  EXPECT_THAT(farm_.uploads(), testing::Contains("light"));
  const v1::JobSpec spec = farm_.submissions()[0].spec();
  EXPECT_EQ(spec.scene().dependencies(1).uri(), "environment:sky.exr");
  EXPECT_EQ(spec.environment().uri(), "environment:sky.exr");
  EXPECT_EQ(spec.environment().rotate_degrees(), -90);
  EXPECT_EQ(spec.environment().scale(), 0.5f);
  EXPECT_EQ(spec.lens().f_stop(), 2.8f);
  EXPECT_EQ(spec.lens().focus_metres(), 3);
  EXPECT_EQ(Run({"submit", scene_}), 0);
  EXPECT_FALSE(farm_.submissions()[1].spec().has_environment());
  EXPECT_FALSE(farm_.submissions()[1].spec().has_lens());
}

TEST_F(RunClientTest, RefusesOptionsThatNeedOthers) {
  EXPECT_EQ(Run({"submit", scene_, "--f-stop", "2"}), 2);
  EXPECT_THAT(Err(), HasSubstr("--f-stop and --focus must be given together"));
  EXPECT_EQ(Run({"render", scene_, "-o", folder_.File("out.exr"), "--env-rotate", "90"}), 2);
  EXPECT_THAT(Err(), HasSubstr("--env-rotate and --env-scale require --env"));
  EXPECT_EQ(Run({"submit", scene_, "--env", folder_.File("none.exr")}), 4);
  EXPECT_THAT(Err(), HasSubstr("--env "));
  EXPECT_THAT(farm_.submissions(), testing::IsEmpty());
}

TEST_F(RunClientTest, SendsWhatTheCoordinatorLacksAndNothingTwice) {
  EXPECT_EQ(Run({"submit", scene_}), 0);
  EXPECT_THAT(farm_.uploads(), ElementsAre(kScene, std::string(2'500'000, 'm')));
  EXPECT_EQ(Run({"submit", scene_}), 0);
  EXPECT_EQ(farm_.uploads().size(), 2u);
  EXPECT_NE(farm_.submissions()[0].request_id(), farm_.submissions()[1].request_id());
}

TEST_F(RunClientTest, RendersThroughTheLocalFarm) {
  const std::string out = folder_.File("out.exr");
  EXPECT_EQ(Run({"render", scene_, "--reproducible", "-o", out, "--threads", "3", "--state", "here", "--json",
                 "--noisy", folder_.File("noisy.png")}),
            0)
      << Err();
  EXPECT_EQ(folder_.Read("out.exr"), farm_.result);
  EXPECT_EQ(folder_.Read("noisy.png").substr(1, 3), "PNG");
  ASSERT_EQ(local_options_.size(), 1u);
  EXPECT_EQ(local_options_[0].threads, 3);
  EXPECT_EQ(local_options_[0].state_dir, "here");
  EXPECT_THAT(Out(), HasSubstr(R"("state":"done")"));
  EXPECT_THAT(Out(), HasSubstr(R"("output":")" + out + '"'));
  EXPECT_EQ(folder_.FileCount(), 5);  // room.gltf, mesh.bin, result; out.exr, noisy.png
}

TEST_F(RunClientTest, RendersToPngAndLeavesNoPart) {
  EXPECT_EQ(Run({"render", scene_, "-o", folder_.File("out.png"), "--exposure", "2.5"}), 0) << Err();
  EXPECT_EQ(folder_.Read("out.png").substr(1, 3), "PNG");
  EXPECT_EQ(Out(), "");
  EXPECT_EQ(folder_.FileCount(), 4);
}

TEST_F(RunClientTest, LeavesNothingOfARenderThatFailed) {
  farm_.watched = {Job(v1::JOB_STATE_FAILED)};
  farm_.watched[0].set_error("tile 3: NaN");
  EXPECT_EQ(Run({"render", scene_, "-o", folder_.File("out.exr")}), 1);
  EXPECT_THAT(Err(), testing::EndsWith("lumifold: job job-1 failed: tile 3: NaN\n"));
  EXPECT_EQ(folder_.FileCount(), 3);
}

TEST_F(RunClientTest, CancelsARenderThatIsInterrupted) {
  farm_.watched = {Job(v1::JOB_STATE_RUNNING)};
  farm_.hold_watch = true;
  int questions = 0;
  test_.environment.interrupted = [&] { return ++questions > 20; };
  EXPECT_EQ(Run({"render", scene_, "-o", folder_.File("out.exr")}), 130);
  EXPECT_THAT(Err(), testing::EndsWith("lumifold: interrupted\n"));
  EXPECT_THAT(farm_.cancelled(), ElementsAre("job-1"));
  EXPECT_EQ(folder_.FileCount(), 3);
}

TEST_F(RunClientTest, DownloadsIntoPlace) {
  farm_.jobs = {{"job-1", Job(v1::JOB_STATE_DONE)}};
  EXPECT_EQ(Run({"download", "job-1", "-o", folder_.File("out.exr"), "--reproducible", "--json"}), 0)
      << Err();
  EXPECT_EQ(folder_.Read("out.exr"), farm_.result);
  EXPECT_EQ(Out(), R"({"schema_version":1,"job_id":"job-1","frame":0,"output":")" + folder_.File("out.exr") +
                       "\"}\n");
  EXPECT_EQ(folder_.FileCount(), 4);
}

TEST_F(RunClientTest, ReportsAJobThatIsUnknown) {
  for (const char* command : {"status", "wait", "watch"}) {
    farm_.watched.clear();
    EXPECT_EQ(Run({command, "job-9"}), 4) << command;
  }
  EXPECT_EQ(Err(), "lumifold: no job 'job-9'\nlumifold: no job 'job-9'\nlumifold: no job 'job-9'\n");
  EXPECT_EQ(Out(), "");
}

TEST_F(RunClientTest, WaitEndsWithTheFateOfTheJob) {
  farm_.watched = {Job(v1::JOB_STATE_CANCELLED)};
  EXPECT_EQ(Run({"wait", "job-1"}), 5);
  EXPECT_EQ(Out(), "cancelled\n");
  EXPECT_EQ(Err(), "");
}

TEST_F(RunClientTest, WatchPrintsAnObjectForEachStatus) {
  EXPECT_EQ(Run({"watch", "job-1", "--json"}), 0);
  const std::string out = Out();
  EXPECT_EQ(std::count(out.begin(), out.end(), '\n'), 2);
  EXPECT_THAT(out, StartsWith(R"({"schema_version":1,"job_id":"job-1","state":"running",)"));
  EXPECT_THAT(out, HasSubstr("\n"
                             R"({"schema_version":1,"job_id":"job-1","state":"done",)"));
}

TEST_F(RunClientTest, ListsJobsUpToTheLimit) {
  farm_.jobs = {{"job-1", Job(v1::JOB_STATE_DONE)}, {"job-2", Job(v1::JOB_STATE_PLANNED)}};
  EXPECT_EQ(Run({"list", "--limit", "1"}), 0);
  EXPECT_THAT(Out(), HasSubstr("job-1                done            100%"));
  EXPECT_THAT(Out(), testing::Not(HasSubstr("planned")));
}

TEST_F(RunClientTest, ListsJobsPageByPageWithFilters) {
  farm_.jobs.clear();
  for (int i = 0; i < 5; ++i) {
    const std::string id = "j-" + std::to_string(i);
    farm_.jobs[id] = Job(v1::JOB_STATE_DONE);
    farm_.jobs[id].set_job_id(id);
    farm_.jobs[id].mutable_scheduling()->set_user("ann");
  }
  farm_.page_jobs = 2;
  EXPECT_EQ(Run({"list", "--json", "--limit", "1001", "--state", "done,failed", "--state", "paused", "--user",
                 "ann"}),
            0)
      << Err();
  const std::string out = Out();
  EXPECT_EQ(std::count(out.begin(), out.end(), '\n'), 5);
  EXPECT_THAT(out, HasSubstr(R"("user":"ann")"));
  const std::string filters =
      R"( states: JOB_STATE_DONE states: JOB_STATE_FAILED states: JOB_STATE_PAUSED user: "ann")";
  EXPECT_THAT(farm_.calls(), ElementsAre("ListJobs limit: 1000" + filters,
                                         R"(ListJobs limit: 999 page_token: "j-1")" + filters,
                                         R"(ListJobs limit: 997 page_token: "j-3")" + filters));
  EXPECT_EQ(Run({"list", "--state", "finished"}), 2);
  EXPECT_THAT(Err(), HasSubstr("lumifold list: --state: no state 'finished'; there are submitted, planned"));
}

TEST_F(RunClientTest, SendsHowAJobIsScheduled) {
  test_.environment.defaults.user = "ann";
  farm_.jobs = {{"j-1", Job(v1::JOB_STATE_RUNNING)}, {"j-2", Job(v1::JOB_STATE_RUNNING)}};
  EXPECT_EQ(Run({"submit",
                 scene_,
                 "--priority",
                 "-20",
                 "--tag",
                 "gpu,night",
                 "--tag",
                 "big",
                 "--max-leases",
                 "7",
                 "--after",
                 "j-1",
                 "--after",
                 "j-2",
                 "--class",
                 "lumifold/avx2",
                 "--paused",
                 "--audit-share",
                 "0.25",
                 "--webhook",
                 "https://hooks.example.org/"}),
            0)
      << Err();
  EXPECT_EQ(Run({"submit", scene_, "--user", "ben"}), 0);
  const v1::Scheduling scheduling = farm_.submissions()[0].scheduling();
  EXPECT_EQ(scheduling.priority(), -20);
  EXPECT_EQ(scheduling.user(), "ann");
  EXPECT_THAT(scheduling.tags(), ElementsAre("gpu", "night", "big"));
  EXPECT_EQ(scheduling.max_leases(), 7);
  EXPECT_THAT(scheduling.after(), ElementsAre("j-1", "j-2"));
  EXPECT_EQ(scheduling.numeric_class(), "lumifold/avx2");
  EXPECT_TRUE(scheduling.paused());
  EXPECT_EQ(scheduling.audit_share(), 0.25);
  EXPECT_EQ(scheduling.webhook(), "https://hooks.example.org/");
  EXPECT_EQ(farm_.submissions()[1].scheduling().user(), "ben");
  EXPECT_EQ(farm_.submissions()[1].scheduling().priority(), 0);
  EXPECT_EQ(Run({"submit", scene_, "--audit-share", "1.5"}), 2);
  EXPECT_EQ(Run({"submit", scene_, "--tag", "a,,b"}), 2);
  EXPECT_THAT(Err(), HasSubstr("--audit-share: expected a number from 0 to 1; got '1.5'"));
  EXPECT_THAT(Err(), HasSubstr("--tag: expected a non-empty text"));
}

TEST_F(RunClientTest, AWorkerThatIsNotThereIsNotFound) {
  EXPECT_EQ(Run({"workers", "node-99"}), 4);
  EXPECT_THAT(Err(), HasSubstr("no worker 'node-99'"));
}

TEST_F(RunClientTest, PrintsUsageByUserAndJob) {
  EXPECT_EQ(Run({"usage", "--since", "2026-11-01", "--until", "2026-12-01", "--user", "ann"}), 0) << Err();
  EXPECT_THAT(farm_.calls(), ElementsAre(R"(GetUsage since_unix_ms: 1793491200000 )"
                                         R"(until_unix_ms: 1796083200000 user: "ann")"));
  EXPECT_THAT(
      Out(),
      HasSubstr("2                    ann                       3.000          1.000        20        4\n"));
  EXPECT_THAT(
      Out(),
      HasSubstr("job-2                ben                       1.500          0.500        10        2\n"));
  EXPECT_EQ(Run({"usage", "--json"}), 0);
  EXPECT_THAT(Out(),
              HasSubstr(R"({"schema_version":1,"job_id":"job-1","user":"ann","render_core_seconds":5400.0,)"
                        R"("finish_core_seconds":1800.0,"units":10,"frames":2})"));
  EXPECT_EQ(Run({"usage", "--since", "yesterday"}), 2);
  EXPECT_THAT(Err(), HasSubstr("--since: expected a day such as 2026-11-01; got 'yesterday'"));
}

TEST_F(RunClientTest, ChangesAJob) {
  farm_.jobs = {{"job-1", Job(v1::JOB_STATE_PAUSED)}};
  EXPECT_EQ(Run({"pause", "job-1"}), 0);
  EXPECT_EQ(Run({"resume", "job-1"}), 0);
  EXPECT_EQ(Run({"move-to-front", "job-1"}), 0);
  EXPECT_EQ(Run({"set-priority", "job-1", "-30"}), 0) << Err();
  EXPECT_EQ(Run({"add-samples", "job-1", "256"}), 0);
  EXPECT_EQ(Run({"delete", "job-1"}), 0);
  EXPECT_EQ(Run({"retry", "job-1"}), 0);
  EXPECT_EQ(Run({"retry", "job-1", "--frames", "3-5", "--region", "0,16,32,48", "--filter-only"}), 0);
  EXPECT_EQ(Run({"retry", "job-1", "--skip"}), 0);
  EXPECT_EQ(Run({"retry", "job-1", "--skip", "--frames", "17"}), 0);
  EXPECT_THAT(farm_.calls(), ElementsAre(R"(PauseJob job_id: "job-1")", R"(ResumeJob job_id: "job-1")",
                                         R"(SetJobPriority job_id: "job-1" to_front: true)",
                                         R"(SetJobPriority job_id: "job-1" priority: -30)",
                                         R"(AddSamples job_id: "job-1" samples_per_pixel: 256)",
                                         R"(DeleteJob job_id: "job-1")", R"(RetryJob job_id: "job-1")",
                                         R"(RetryJob job_id: "job-1" frames: 3 frames: 4 frames: 5 )"
                                         R"(region { y0: 16 x1: 32 y1: 48 } filter_only: true)",
                                         R"(RetryJob job_id: "job-1" skip: true)",
                                         R"(RetryJob job_id: "job-1" frames: 17 skip: true)"));
  EXPECT_EQ(Out(), "");
  EXPECT_THAT(Err(), StartsWith("lumifold: job job-1 paused\nlumifold: job job-1 paused\n"));
  EXPECT_THAT(Err(), HasSubstr("lumifold: job job-1 deleted\n"));
  EXPECT_EQ(Run({"pause", "job-1", "--json"}), 0);
  EXPECT_THAT(Out(), StartsWith(R"({"schema_version":1,"job_id":"job-1","state":"paused",)"));
  for (const std::vector<std::string>& command : {std::vector<std::string>{"pause", "job-9"},
                                                  {"resume", "job-9"},
                                                  {"set-priority", "job-9", "1"},
                                                  {"add-samples", "job-9", "4"},
                                                  {"delete", "job-9"},
                                                  {"retry", "job-9"},
                                                  {"explain", "job-9"}}) {
    EXPECT_EQ(Run(command), 4) << command[0];
  }
}

TEST_F(RunClientTest, RefusesARegionWithoutPixels) {
  for (const char* region : {"0,0,8", "8,0,8,8", "0,-1,8,8", "a,0,8,8", "0,0,8,8,8"}) {
    EXPECT_EQ(Run({"retry", "job-1", "--region", region}), 2) << region;
  }
  EXPECT_THAT(Err(), HasSubstr("lumifold retry: --region: expected X0,Y0,X1,Y1"));
  EXPECT_EQ(Run({"retry", "job-1", "--frames", "1-2000000000"}), 2);
  EXPECT_EQ(Run({"set-priority", "job-1", "101"}), 2);
  EXPECT_THAT(farm_.calls(), testing::IsEmpty());
}

TEST_F(RunClientTest, ExplainsAJob) {
  farm_.jobs = {{"job-1", Job(v1::JOB_STATE_RUNNING)}};
  EXPECT_EQ(Run({"explain", "job-1"}), 0);
  EXPECT_EQ(Out(), "job: job-1\nstate: running\nnothing holds it up\n");
  test_.out.str("");
  farm_.reasons.emplace_back().set_code("no_worker");
  farm_.reasons.back().set_text("no worker has the tag 'gpu'");
  EXPECT_EQ(Run({"explain", "job-1"}), 0);
  EXPECT_EQ(Run({"explain", "job-1", "--json"}), 0);
  EXPECT_EQ(Out(),
            "job: job-1\nstate: running\nno_worker: no worker has the tag 'gpu'\n"
            R"({"schema_version":1,"job_id":"job-1","state":"running","reasons":[{"code":"no_worker",)"
            R"("text":"no worker has the tag 'gpu'"}]})"
            "\n");
}

TEST_F(RunClientTest, ListsAllWorkers) {
  for (const char* id : {"w-1", "w-2", "w-3"}) {
    v1::WorkerStatus& worker = farm_.workers.emplace_back();
    worker.set_worker_id(id);
    worker.set_name("node:1");
    worker.set_state(v1::WORKER_STATE_BUSY);
    worker.set_slots(8);
    worker.set_leases(5);
    worker.set_seconds_per_unit(1.5);
    worker.add_tags("gpu");
  }
  EXPECT_EQ(Run({"workers"}), 0);
  EXPECT_THAT(Out(), StartsWith("WORKER   NAME "));
  EXPECT_THAT(Out(), HasSubstr("\nw-3      node:1                   busy           5      8        0"));
  test_.out.str("");
  EXPECT_EQ(Run({"workers", "--json"}), 0);
  EXPECT_THAT(
      Out(),
      StartsWith(
          R"({"schema_version":1,"worker_id":"w-1","name":"node:1","process":"","state":"busy","reason":"",)"
          R"("class":"","tags":["gpu"],"slots":8,"leases":5,)"));
  EXPECT_EQ(farm_.calls().size(), 6u);
}

TEST_F(RunClientTest, SaysWhichCoordinatorWorkersAreConnectedTo) {
  for (const char* coordinator : {"rack-1", ""}) {
    v1::WorkerStatus& worker = farm_.workers.emplace_back();
    worker.set_name("node");
    worker.set_reason("why");
    worker.set_coordinator(coordinator);
  }
  EXPECT_EQ(Run({"workers"}), 0);
  EXPECT_THAT(Out(), HasSubstr(" S/UNIT  COORDINATOR      REASON\n"));
  EXPECT_THAT(Out(), HasSubstr("   0.00  rack-1           why\n"));
  EXPECT_THAT(Out(), HasSubstr("   0.00  -                why\n"));
  test_.out.str("");
  EXPECT_EQ(Run({"workers", "--json"}), 0);
  EXPECT_THAT(Out(), HasSubstr(R"("memory_bytes":0,"coordinator":"rack-1"})"));
  EXPECT_THAT(Out(), testing::EndsWith("\"memory_bytes\":0}\n"));
}

TEST_F(RunClientTest, ChangesAWorker) {
  EXPECT_EQ(Run({"drain", "w-1"}), 0);
  EXPECT_EQ(Run({"block", "node:1", "--reason", "wrong pixels"}), 0);
  EXPECT_EQ(Run({"readmit", "node:1", "--json"}), 0);
  EXPECT_THAT(farm_.calls(), ElementsAre(R"(DrainWorker worker: "w-1")",
                                         R"(BlockWorker worker: "node:1" reason: "wrong pixels")",
                                         R"(ReadmitWorker worker: "node:1")"));
  EXPECT_EQ(Err(),
            "lumifold: worker w-1 draining\nlumifold: worker node:1 blocked\n"
            "lumifold: worker node:1 idle\n");
  EXPECT_THAT(Out(), HasSubstr(R"("name":"node:1","process":"","state":"idle")"));
}

TEST_F(RunClientTest, PrintsTheLogOfAJobOrAWorker) {
  v1::LogEvent& event = farm_.events.emplace_back();
  event.set_unix_ms(1'000);
  event.set_level("warn");
  event.set_text("event=unit_failed");
  farm_.jobs = {{"j-1", Job(v1::JOB_STATE_RUNNING)}};
  EXPECT_EQ(Run({"logs", "j-1"}), 0);
  EXPECT_EQ(Run({"logs", "node:1", "--limit", "5", "--json"}), 0);
  EXPECT_EQ(Out(),
            "1970-01-01T00:00:01.000Z warn  event=unit_failed\n"
            R"({"schema_version":1,"unix_ms":1000,"level":"warn","text":"event=unit_failed"})"
            "\n");
  EXPECT_THAT(farm_.calls(),
              ElementsAre(R"(GetLog job_id: "j-1" limit: 100)", R"(GetLog worker: "node:1" limit: 5)"));
}

TEST_F(RunClientTest, PrintsTheStateOfTheCoordinator) {
  farm_.server_status.set_version("1.2.3");
  farm_.server_status.set_free_bytes(12'340'000'000);
  farm_.server_status.set_insecure(true);
  EXPECT_EQ(Run({"server-status"}), 0);
  EXPECT_THAT(Out(), StartsWith("version: 1.2.3\nstorage: ok\nfree: 12.3 GB\n"));
  test_.out.str("");
  farm_.server_status.set_storage_error("no space left on device");
  EXPECT_EQ(Run({"server-status"}), 0);
  EXPECT_THAT(Out(), HasSubstr("storage: no space left on device\n"));
  EXPECT_EQ(Run({"server-status", "--json"}), 0);
  EXPECT_THAT(
      Out(),
      HasSubstr(R"({"schema_version":1,"version":"1.2.3","storage_error":"no space left on device",)"));
}

TEST_F(RunClientTest, PrintsTheCoordinatorsOfAFarmOfSeveral) {
  EXPECT_EQ(Run({"server-status"}), 0);
  EXPECT_EQ(Run({"server-status", "--json"}), 0);
  EXPECT_THAT(Out(), testing::Not(HasSubstr("coordinator")));
  v1::CoordinatorStatus& one = *farm_.server_status.add_coordinators();
  one.set_name("rack-1");
  one.set_address("a:7700");
  one.set_epoch(3);
  one.set_active_jobs(2);
  one.set_workers(4);
  one.set_slots(32);
  one.set_demand(100);
  test_.out.str("");
  EXPECT_EQ(Run({"server-status"}), 0);
  EXPECT_THAT(Out(), testing::EndsWith(
                         "\ncoordinator: rack-1 at a:7700, epoch 3: active jobs 2, workers 4, slots 32, "
                         "demand 100\n"));
  EXPECT_EQ(Run({"server-status", "--json"}), 0);
  EXPECT_THAT(Out(),
              HasSubstr(R"("coordinators":[{"name":"rack-1","address":"a:7700","epoch":3,"active_jobs":2,)"
                        R"("workers":4,"slots":32,"demand":100}]})"));
}

TEST_F(RunClientTest, GoesOnToTheNextCoordinatorAndNamesAllWhereNoneAnswers) {
  std::string gone;
  {
    const FakeFarm ended;
    gone = ended.address();
  }
  EXPECT_EQ(Run({"server-status", "--server", gone + "," + farm_.address()}), 0);
  EXPECT_EQ(Run({"server-status", "--server", gone + ",127.0.0.1:1"}), 3);
  EXPECT_EQ(Err(),
            "lumifold: cannot reach any of the coordinators " + gone + ", 127.0.0.1:1: Connection refused\n");
}

TEST_F(RunClientTest, ChecksEachCoordinatorOfTheList) {
  EXPECT_EQ(Run({"server-status", "--server", farm_.address() + ",farm.example:7700"}), 1);
  EXPECT_THAT(Err(), HasSubstr("there is no profile for the coordinator at farm.example:7700"));
  test_.environment.defaults.server = "a:7700,a:7700";
  EXPECT_EQ(Run({"server-status"}), 2);
  EXPECT_THAT(Err(), HasSubstr("'a:7700' is twice in the list"));
}

TEST_F(RunClientTest, CancelsAJob) {
  EXPECT_EQ(Run({"cancel", "job-1"}), 0);
  EXPECT_THAT(farm_.cancelled(), ElementsAre("job-1"));
  EXPECT_EQ(Err(), "lumifold: job job-1 cancelled\n");
}

}  // namespace
}  // namespace lumifold::client
