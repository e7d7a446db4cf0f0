#include "worker/cache/spec_cache.h"

#include <gtest/gtest.h>

#include <string>
#include <thread>
#include <vector>

#include "absl/synchronization/mutex.h"
#include "absl/synchronization/notification.h"
#include "tests/unit/worker/fake_specs.h"

namespace lumifold::worker {
namespace {

v1::JobSpec SpecOf(int width) {
  v1::JobSpec spec;
  spec.mutable_planning()->set_mode(v1::PLAN_MODE_FULL);
  spec.set_width(width);
  return spec;
}

/// Blocks each fetch until it is released.
class SlowSpecs final : public SpecSource {
 public:
  absl::StatusOr<v1::JobSpec> Fetch(const std::string&) override {
    const int call = ++fetches;
    if (call == 1) started.Notify();
    released.WaitForNotification();
    return SpecOf(call);
  }
  std::atomic<int> fetches = 0;
  absl::Notification started;
  absl::Notification released;
};

TEST(SpecCache, FetchesTheSpecOfAJobOnceUntilItIsForgotten) {
  FakeSpecs source{SpecOf(7)};
  SpecCache specs(&source);
  for (const char* job : {"j", "k", "j", "k"}) EXPECT_EQ((*specs.Get(job, v1::UNIT_KIND_PASS))->width(), 7);
  EXPECT_EQ(source.fetches, 2);
  specs.Forget("j");
  for (const char* job : {"j", "k"}) EXPECT_TRUE(specs.Get(job, v1::UNIT_KIND_PASS).ok());
  EXPECT_EQ(source.fetches, 3);
  specs.Clear();
  EXPECT_TRUE(specs.Get("k", v1::UNIT_KIND_PASS).ok());
  EXPECT_EQ(source.fetches, 4);
}

TEST(SpecCache, FetchesTheSpecAgainOnceTheJobIsPlanned) {
  FakeSpecs unplanned{v1::JobSpec()};
  SpecCache specs(&unplanned);
  for (int i = 0; i < 2; ++i) EXPECT_TRUE(specs.Get("j", v1::UNIT_KIND_PLAN).ok());
  EXPECT_EQ(unplanned.fetches, 1);
  EXPECT_TRUE(specs.Get("j", v1::UNIT_KIND_GEOMETRY).ok());
  EXPECT_EQ(unplanned.fetches, 2) << "what it has is of the time before the plan";
  v1::JobSpec spec;
  spec.mutable_plan();
  FakeSpecs source{spec};
  SpecCache planned(&source);
  for (const v1::UnitKind kind : {v1::UNIT_KIND_GEOMETRY, v1::UNIT_KIND_PASS, v1::UNIT_KIND_PLAN})
    EXPECT_TRUE(planned.Get("j", kind).ok());
  EXPECT_EQ(source.fetches, 1);
}

TEST(SpecCache, DoesNotKeepErrors) {
  FakeSpecs source{absl::UnavailableError("gone")};
  SpecCache specs(&source);
  for (int i = 0; i < 2; ++i)
    EXPECT_EQ(specs.Get("j", v1::UNIT_KIND_PASS).status(), absl::UnavailableError("gone"));
  EXPECT_EQ(source.fetches, 2);
}

TEST(SpecCache, ThreadsShareWhatIsBeingFetched) {
  SlowSpecs source;
  SpecCache specs(&source);
  std::vector<std::thread> threads;
  for (int i = 0; i < 8; ++i)
    threads.emplace_back([&] { EXPECT_EQ((*specs.Get("j", v1::UNIT_KIND_PASS))->width(), 1); });
  source.released.Notify();
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(source.fetches, 1);
}

TEST(SpecCache, DoesNotKeepTheSpecOfAJobThatEndedMeanwhile) {
  SlowSpecs source;
  SpecCache specs(&source);
  std::thread thread([&] { EXPECT_EQ((*specs.Get("j", v1::UNIT_KIND_PASS))->width(), 1); });
  source.started.WaitForNotification();
  specs.Forget("j");
  source.released.Notify();
  thread.join();
  EXPECT_EQ((*specs.Get("j", v1::UNIT_KIND_PASS))->width(), 2) << "fetched again";
}

}  // namespace
}  // namespace lumifold::worker
