// What a coordinator's metrics say: each figure in its place.
#include "server/coordinator/metrics.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <prometheus/collectable.h>
#include <prometheus/metric_family.h>
#include <spdlog/logger.h>

#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "server/coordinator/farm_state.h"
#include "server/job/job_spec.h"
#include "server/metrics/farm_metrics.h"
#include "tests/support/temp_folder.h"

namespace lumifold::server {
namespace {

using job::JobId;
using ::testing::ElementsAre;
using ::testing::Pair;
using ::testing::UnorderedElementsAre;

/// The samples of a source: NAME or NAME{VALUE OF THE LABEL}.
std::map<std::string, double> SamplesOf(const prometheus::Collectable& source) {
  std::map<std::string, double> samples;
  for (const prometheus::MetricFamily& family : source.Collect()) {
    for (const prometheus::ClientMetric& metric : family.metric) {
      const std::string label = metric.label.empty() ? "" : "{" + metric.label[0].value + "}";
      const bool is_counter = family.type == prometheus::MetricType::Counter;
      samples[family.name.substr(std::string("lumifold_").size()) + label] =
          is_counter ? metric.counter.value : metric.gauge.value;
    }
  }
  return samples;
}

TEST(FarmMetrics, EachFigureHasItsName) {
  monitoring::FarmMetrics metrics;
  metrics.units_queued = 1;
  metrics.units_leased = 2;
  metrics.units_committed = 3;
  metrics.worker_slots = 4;
  metrics.page_viewers = 5;
  metrics.workers = {{v1::WORKER_STATE_IDLE, 6}, {v1::WORKER_STATE_SET_ASIDE, 7}};
  metrics.jobs = {{v1::JOB_STATE_RUNNING, 8}, {v1::JOB_STATE_PAUSED, 9}};
  metrics.blocked_names = 10;
  metrics.frames.filtering = 33;
  metrics.frames.waiting = 34;
  metrics.frames.on_workers = 35;
  metrics.traffic.units_sent = 36;
  metrics.traffic.results_received = 37;
  metrics.samples_committed = 11;
  metrics.leases_expired = 12;
  metrics.retries = {{"failed", 13}, {"stalled", 14}};
  metrics.traffic.units_received = 15;
  metrics.traffic.assets_received = 16;
  metrics.traffic.results_sent = 17;
  metrics.traffic.assets_sent = 18;
  metrics.webhooks.set_waiting(38);
  metrics.webhooks.set_delivered(39);
  metrics.webhooks.set_failed(40);
  metrics.webhooks.set_given_up(41);
  metrics.storage.writable = false;
  metrics.storage.free_bytes = 19;
  metrics.storage.room_bytes = 20;
  EXPECT_THAT(SamplesOf(*monitoring::MakeFarmMetrics([&] { return metrics; })),
              UnorderedElementsAre(
                  Pair("units_queued", 1), Pair("units_leased", 2), Pair("units_committed_total", 3),
                  Pair("worker_slots", 4), Pair("page_viewers", 5), Pair("workers{idle}", 6),
                  Pair("workers{set_aside}", 7), Pair("workers{busy}", 0), Pair("workers{draining}", 0),
                  Pair("workers{silent}", 0), Pair("workers{blocked}", 0), Pair("workers{resting}", 0),
                  Pair("jobs{running}", 8), Pair("jobs{paused}", 9), Pair("jobs{submitted}", 0),
                  Pair("jobs{planned}", 0), Pair("jobs{filtering}", 0), Pair("frames{filtering}", 33),
                  Pair("frames{on_workers}", 35), Pair("frames{waiting}", 34), Pair("blocked_workers", 10),
                  Pair("samples_committed_total", 11), Pair("lease_expiries_total", 12),
                  Pair("unit_retries_total{failed}", 13), Pair("unit_retries_total{stalled}", 14),
                  Pair("received_bytes_total{units}", 15), Pair("received_bytes_total{results}", 37),
                  Pair("received_bytes_total{assets}", 16), Pair("sent_bytes_total{results}", 17),
                  Pair("sent_bytes_total{units}", 36), Pair("sent_bytes_total{assets}", 18),
                  Pair("webhooks_waiting", 38), Pair("webhook_calls_total{delivered}", 39),
                  Pair("webhook_calls_total{failed}", 40), Pair("webhook_calls_total{given_up}", 41),
                  Pair("storage_writable", 0), Pair("disk_free_bytes", 19), Pair("disk_room_bytes", 20)));
  metrics.storage.writable = true;
  EXPECT_EQ(SamplesOf(*monitoring::MakeFarmMetrics([&] { return metrics; }))["storage_writable"], 1);
}

class NoEffects final : public FarmEffects {
 public:
  void RecordEnd(const JobId&, v1::JobState, const std::string&) override {}
  void CancelFinishing(const JobId&) override {}
  void DiscardUnits(const FrameKey&, const std::vector<job::UnitKey>&) override {}
  void RecordBlock(const std::string&, const std::string&) override {}
  void SkipFrame(const FrameKey&, const std::string&) override {}
  void KeepPrerequisites(const std::set<JobId>&) override {}
  void WakeHousekeeping() override {}
  void WakeFinisher() override {}
};

/// A job of one tile: a geometry unit and two passes.
ledger::JobRecord OneTile(const std::string& id) {
  v1::JobSpec spec;
  spec.mutable_scene()->mutable_file()->set_sha256(std::string(64, 'a'));
  spec.set_frame_count(1);
  spec.set_width(8);
  spec.set_height(8);
  spec.set_tile_size(8);
  spec.set_samples_per_pixel(8);
  spec.set_pass_samples(4);
  spec.mutable_planning()->set_mode(v1::PLAN_MODE_FULL);
  ledger::JobRecord record;
  record.id = JobId(id);
  record.spec = *job::NormaliseJobSpec(spec);
  return record;
}

TEST(MetricsOf, CountsJobsAsTheirClientsSeeThem) {
  TempFolder folder;
  CoordinatorOptions options;
  options.now = options.wall_now = [] { return absl::FromUnixSeconds(1000); };
  options.log = std::make_shared<spdlog::logger>("none");
  Resources resources(options, DataFolder(folder.PathOf("data")), nullptr, nullptr, nullptr,
                      {"owner", ledger::Epoch(1)});
  NoEffects effects;
  FarmState state(&resources, &effects);
  {
    FarmState::Change farm(&state);
    farm->LimitFrames(uint64_t{1} << 40);
    farm->StartJob(OneTile("j-1"), {});
    farm->StartJob(OneTile("j-2"), {{JobId("j-1"), v1::JOB_STATE_RUNNING}});
    ledger::JobRecord waiting_and_paused = OneTile("j-3");
    waiting_and_paused.scheduling.set_paused(true);
    farm->StartJob(waiting_and_paused, {{JobId("j-1"), v1::JOB_STATE_RUNNING}});
    farm->StartJob(OneTile("j-4"), {});
    farm->jobs.FindActive(JobId("j-4"))->record.scheduling.set_paused(true);
    farm->UpdatePause(JobId("j-4"));
    farm->totals = {.units_committed = 31, .samples_committed = 32};
  }
  resources.traffic.units_received = 1;
  resources.traffic.assets_received = 2;
  resources.traffic.results_sent = 3;
  resources.traffic.assets_sent = 4;
  monitoring::FarmMetrics metrics = MetricsOf(resources, &state);
  EXPECT_THAT(metrics.jobs, ElementsAre(Pair(v1::JOB_STATE_SUBMITTED, 2), Pair(v1::JOB_STATE_PLANNED, 1),
                                        Pair(v1::JOB_STATE_PAUSED, 1)));
  for (const auto& [id, state_of] : std::map<std::string, v1::JobState>{{"j-1", v1::JOB_STATE_PLANNED},
                                                                        {"j-2", v1::JOB_STATE_SUBMITTED},
                                                                        {"j-3", v1::JOB_STATE_SUBMITTED},
                                                                        {"j-4", v1::JOB_STATE_PAUSED}})
    EXPECT_EQ(FarmState::View(&state)->StatusOf(JobId(id))->state(), state_of) << id;
  EXPECT_EQ(metrics.units_queued, 3) << "of the job that may run";
  EXPECT_EQ(metrics.units_leased, 0);
  EXPECT_EQ(metrics.units_committed, 31);
  EXPECT_EQ(metrics.samples_committed, 32);
  EXPECT_EQ(metrics.traffic.units_received, 1);
  EXPECT_EQ(metrics.traffic.assets_received, 2);
  EXPECT_EQ(metrics.traffic.results_sent, 3);
  EXPECT_EQ(metrics.traffic.assets_sent, 4);
  EXPECT_EQ(metrics.retries.size(), 10u);
  EXPECT_TRUE(metrics.storage.writable);
  resources.storage.Fail(absl::UnavailableError("full"));
  EXPECT_FALSE(MetricsOf(resources, &state).storage.writable);
}

}  // namespace
}  // namespace lumifold::server
