#include "server/storage/retention.h"

#include <gtest/gtest.h>

#include <random>

#include "absl/strings/str_cat.h"

namespace lumifold::server {
namespace {

using job::JobId;
using What = Removal::What;

const JobId kOld("j-old"), kNew("j-new"), kRunning("j-running");
constexpr uint64_t kPlenty = uint64_t{1} << 50;

absl::Time AtHour(int hours) { return absl::UnixEpoch() + absl::Hours(hours); }

/// No limit but those that a test sets.
RetentionLimits NoLimits() {
  return {
      .film_bytes = kPlenty, .free_bytes = 0, .quota_bytes = {}, .keep_results = absl::InfiniteDuration()};
}

void ExpectNext(const Retention& retention, absl::Time now, uint64_t free, What what, const JobId& job) {
  const std::optional<Removal> removal = retention.Next(now, free);
  ASSERT_TRUE(removal.has_value());
  EXPECT_EQ(removal->what, what);
  EXPECT_EQ(removal->job, job);
  EXPECT_FALSE(removal->cause.empty());
}

TEST(Retention, FilmOfTheJobThatEndedFirstGoesFirst) {
  RetentionLimits limits = NoLimits();
  limits.film_bytes = 100;
  Retention retention(limits);
  retention.JobEnded(kNew, AtHour(2), 60, 5);
  EXPECT_FALSE(retention.Next(AtHour(3), kPlenty).has_value());
  retention.JobEnded(kOld, AtHour(1), 60, 5);
  ExpectNext(retention, AtHour(3), kPlenty, What::kFilm, kOld);
  retention.FilmRemoved(kOld);
  EXPECT_FALSE(retention.Next(AtHour(3), kPlenty).has_value());
  EXPECT_EQ(retention.film_bytes(), 60u);
  EXPECT_EQ(retention.used_bytes(), 70u);
}

TEST(Retention, WhatIsExactlyAtALimitStays) {
  for (const int off : {0, 1}) {  // of a byte beyond the limit
    const auto extra = static_cast<uint64_t>(off);
    RetentionLimits of_film = NoLimits();
    of_film.film_bytes = 60;
    RetentionLimits of_quota = NoLimits();
    of_quota.quota_bytes = 65;
    RetentionLimits of_disk = NoLimits();
    of_disk.free_bytes = 1000;
    for (const RetentionLimits& limits : {of_film, of_quota, of_disk}) {
      Retention retention(limits);
      retention.JobEnded(kOld, AtHour(1), 60 + extra, 5);
      EXPECT_EQ(retention.Next(AtHour(3), 1000 - extra).has_value(), off == 1);
    }
  }
}

TEST(Retention, NoFilmIsKeptUnderALimitOfZero) {
  RetentionLimits limits = NoLimits();
  limits.film_bytes = 0;
  Retention retention(limits);
  retention.FrameFinished(kRunning, 3, AtHour(1), 10);
  const std::optional<Removal> removal = retention.Next(AtHour(1), kPlenty);
  ASSERT_TRUE(removal.has_value());
  EXPECT_EQ(removal->what, What::kFrame);
  EXPECT_EQ(removal->frame, 3);
  retention.FrameRemoved(kRunning, 3);
  EXPECT_FALSE(retention.Next(AtHour(1), kPlenty).has_value());
}

TEST(Retention, EndedJobsComeBeforeFinishedFramesOfActiveOnes) {
  RetentionLimits limits = NoLimits();
  limits.film_bytes = 10;
  Retention retention(limits);
  retention.FrameFinished(kRunning, 1, AtHour(1), 10);
  retention.JobEnded(kNew, AtHour(5), 10, 0);
  ExpectNext(retention, AtHour(6), kPlenty, What::kFilm, kNew);
}

TEST(Retention, FilmGoesWhileTheDiskIsNearlyFullButResultsStay) {
  RetentionLimits limits = NoLimits();
  limits.free_bytes = 1000;
  Retention retention(limits);
  retention.JobEnded(kOld, AtHour(1), 10, 10);
  EXPECT_FALSE(retention.Next(AtHour(2), 1000).has_value());
  ExpectNext(retention, AtHour(2), 999, What::kFilm, kOld);
  retention.FilmRemoved(kOld);
  EXPECT_FALSE(retention.Next(AtHour(2), 0).has_value());
}

TEST(Retention, TheQuotaTakesFilmsAndThenResults) {
  RetentionLimits limits = NoLimits();
  limits.quota_bytes = 100;
  Retention retention(limits);
  retention.SetOtherBytes(50);
  retention.JobEnded(kOld, AtHour(1), 20, 40);
  retention.JobEnded(kNew, AtHour(2), 20, 40);
  ExpectNext(retention, AtHour(3), kPlenty, What::kFilm, kOld);
  retention.FilmRemoved(kOld);
  ExpectNext(retention, AtHour(3), kPlenty, What::kFilm, kNew);
  retention.FilmRemoved(kNew);
  ExpectNext(retention, AtHour(3), kPlenty, What::kJob, kOld);
  retention.Forget(kOld);
  EXPECT_EQ(retention.used_bytes(), 90u);
  EXPECT_FALSE(retention.Next(AtHour(3), kPlenty).has_value());
  retention.SetOtherBytes(60);
  EXPECT_FALSE(retention.Next(AtHour(3), kPlenty).has_value()) << "the quota is not exceeded";
  retention.SetOtherBytes(61);
  ExpectNext(retention, AtHour(3), kPlenty, What::kJob, kNew);
}

TEST(Retention, ActiveJobsStayWhateverTheQuota) {
  RetentionLimits limits = NoLimits();
  limits.quota_bytes = 10;
  Retention retention(limits);
  retention.SetOtherBytes(1000);
  EXPECT_FALSE(retention.Next(AtHour(1), kPlenty).has_value());
  EXPECT_GT(retention.used_bytes(), *limits.quota_bytes);  // new submissions are refused
}

TEST(Retention, JobsAreDeletedAtTheirAge) {
  RetentionLimits limits = NoLimits();
  limits.keep_results = absl::Hours(24);
  Retention retention(limits);
  retention.JobEnded(kOld, AtHour(1), 10, 10);
  retention.JobEnded(kNew, AtHour(2), 10, 10);
  EXPECT_FALSE(retention.Next(AtHour(24), kPlenty).has_value());
  ExpectNext(retention, AtHour(25), kPlenty, What::kJob, kOld);
  retention.SetNeeded({kOld});
  EXPECT_FALSE(retention.Next(AtHour(25), kPlenty).has_value());
  ExpectNext(retention, AtHour(26), kPlenty, What::kJob, kNew);
}

TEST(Retention, AJobThatRunsAgainIsForgotten) {
  RetentionLimits limits = NoLimits();
  limits.film_bytes = 0;
  Retention retention(limits);
  retention.JobEnded(kOld, AtHour(1), 10, 10);
  retention.Forget(kOld);
  EXPECT_FALSE(retention.Next(AtHour(9), kPlenty).has_value());
  EXPECT_EQ(retention.used_bytes(), 0u);
  retention.FrameFinished(kOld, 0, AtHour(2), 10);
  retention.JobEnded(kOld, AtHour(3), 30, 10);  // the whole film, its frames included
  EXPECT_EQ(retention.film_bytes(), 30u);
}

// Any history: the sums are those of what is left, and doing what Next says ends within the limits or with
// nothing that may go.
TEST(Retention, SumsHoldAndRemovalEnds) {
  for (uint32_t seed = 0; seed < 100; ++seed) {
    std::mt19937 random(seed);
    RetentionLimits limits = NoLimits();
    limits.film_bytes = random() % 500;
    limits.quota_bytes = random() % 2000;
    Retention retention(limits);
    retention.SetOtherBytes(random() % 1500);
    for (int step = 0; step < 200; ++step) {
      const JobId job(absl::StrCat("j-", random() % 20));
      switch (random() % 4) {
        case 0:
          retention.JobEnded(job, AtHour(static_cast<int>(random() % 100)), random() % 100, random() % 100);
          break;
        case 1:
          retention.FrameFinished(JobId(absl::StrCat("active-", random() % 5)),
                                  static_cast<int32_t>(random() % 5),
                                  AtHour(static_cast<int>(random() % 100)), random() % 100);
          break;
        case 2:
          retention.Forget(job);
          break;
        default:
          while (const std::optional<Removal> removal = retention.Next(AtHour(200), kPlenty)) {
            const uint64_t before = retention.used_bytes();
            if (removal->what == What::kJob) retention.Forget(removal->job);
            if (removal->what == What::kFilm) retention.FilmRemoved(removal->job);
            if (removal->what == What::kFrame) retention.FrameRemoved(removal->job, removal->frame);
            ASSERT_LE(retention.used_bytes(), before) << "seed " << seed;
          }
          ASSERT_LE(retention.film_bytes(), limits.film_bytes) << "seed " << seed;
      }
    }
    for (int i = 0; i < 20; ++i) retention.Forget(JobId(absl::StrCat("j-", i)));
    for (int i = 0; i < 5; ++i) retention.Forget(JobId(absl::StrCat("active-", i)));
    retention.SetOtherBytes(0);
    EXPECT_EQ(retention.used_bytes(), 0u) << "seed " << seed;
  }
}

}  // namespace
}  // namespace lumifold::server
