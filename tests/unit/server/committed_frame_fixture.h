#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <functional>
#include <iterator>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "server/film/unit_log.h"
#include "server/job/frame_rounds.h"
#include "server/job/tile_grid.h"
#include "server/ledger/sqlite_job_store.h"
#include "server/storage/data_folder.h"
#include "tests/support/encoded_unit.h"
#include "tests/support/random_unit.h"
#include "tests/support/temp_folder.h"

namespace lumifold::server {

/// A data folder with committed frames, as written by a coordinator. The units are RandomUnits of seed 1
/// without rays, unless a test says otherwise.
class CommittedFrameFixture : public ::testing::Test {
 protected:
  CommittedFrameFixture() {
    EXPECT_TRUE(folder_.Claim().ok());
    store_ = *ledger::OpenSqliteJobStore(folder_.LedgerPath());
  }

  static v1::JobSpec Spec(int width, int height) {
    v1::JobSpec spec;
    spec.mutable_planning()->set_mode(v1::PLAN_MODE_FULL);
    spec.set_width(width);
    spec.set_height(height);
    spec.set_tile_size(8);
    spec.set_samples_per_pixel(10);
    spec.set_pass_samples(4);
    spec.set_frame_count(1);
    spec.mutable_filter()->set_method("default");
    return spec;
  }

  /// Commits the units of frame 0 of a job for which `has` is true, from the last to the first, or in order
  /// if `is_forward`.
  void Commit(
      const job::JobId& id, const v1::JobSpec& spec, bool is_forward = false,
      const std::function<bool(const job::UnitKey&)>& has = [](const job::UnitKey&) { return true; }) {
    ledger::NewJob job{.id = id, .request_id = id.value(), .spec = spec, .submitted = absl::Now()};
    EXPECT_TRUE(store_->CreateJob(job).ok());
    EXPECT_TRUE(MakeFolder(folder_.FilmPath(id)).ok());
    std::vector<std::string> names;
    std::vector<film::UnitLog> logs;
    for (int i = 0; i < logs_; ++i) {
      names.push_back(folder_.UnitLogName(id, 0) + (i > 0 ? absl::StrCat(".", i) : ""));
      logs.push_back(*film::UnitLog::Open(folder_.PathOf(names.back()), 0));
    }
    const job::FrameUnits units(spec);
    ledger::JobCommit commit;
    commit.job.job = id;
    for (int64_t i = 0; i < units.count(); ++i) {
      const job::UnitKey key = units.KeyOf(0, is_forward ? i : units.count() - 1 - i);
      if (!has(key)) continue;
      const uint32_t seed = seed_of_ ? seed_of_(key) : 1;
      film::StoredUnit unit{{id, key},
                            job::Attempt(1),
                            {},
                            RandomUnit(key, units.tiles().RectOf(key.tile), SamplesOf(spec, units, key), seed,
                                       FullModelOf(spec))};
      unit.stats.set_catches_shadows(spec.ground() == v1::GROUND_SHADOW);
      if (rays_of_) unit.stats.set_rays(rays_of_(key));
      const size_t log = static_cast<size_t>(i) % logs.size();
      const film::RecordPlace place = *logs[log].Append(Encoded(unit));
      ledger::UnitRecord& record = commit.units.emplace_back();
      record.unit = unit.unit;
      record.attempt = unit.attempt;
      record.file = names[log];
      record.offset = place.offset;
      record.length = place.length;
    }
    EXPECT_TRUE(store_->CommitUnits({commit})->front().ok());
  }

  /// With adaptive sampling: in the rounds before the first estimate, which the whole tile has.
  static SampleRange SamplesOf(const v1::JobSpec& spec, const job::FrameUnits& units,
                               const job::UnitKey& key) {
    if (!spec.has_adaptive() || key.kind != v1::UNIT_KIND_PASS) return units.SamplesOf(key);
    return job::FrameRounds(spec).SamplesOf(key).At(0, 0);
  }

  /// The bytes of frame 0's result; empty if there is none.
  std::string Result(const job::JobId& id) const {
    std::ifstream file(folder_.ResultPath(id, 0), std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }

  /// Of a unit, where they are set.
  std::function<uint32_t(const job::UnitKey&)> seed_of_;
  std::function<int64_t(const job::UnitKey&)> rays_of_;
  int logs_ = 1;  // units are in these by turns, as those of several coordinators are

  TempFolder temp_;
  const DataFolder folder_{temp_.PathOf("data")};
  std::unique_ptr<ledger::JobStore> store_;
};

}  // namespace lumifold::server
