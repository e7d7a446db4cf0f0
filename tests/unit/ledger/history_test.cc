#include "tests/unit/ledger/history.h"

#include <gtest/gtest.h>

#include "tests/unit/ledger/job_store_fixture.h"
#include "tests/unit/ledger/memory_job_store.h"

namespace lumifold::ledger {
namespace {

using JobStoreHistoryTest = JobStoreTest;

INSTANTIATE_TEST_SUITE_P(All, JobStoreHistoryTest, ::testing::ValuesIn(DatabaseKinds()),
                         [](const auto& kind) { return kind.param.name; });

TEST_P(JobStoreHistoryTest, RandomHistoriesGiveWhatTheModelGives) {
  for (uint64_t seed = 1; seed <= 6; ++seed) {
    SetUp();  // an empty database
    const std::unique_ptr<JobStore> model = MakeMemoryJobStore(MakeMemoryState());
    int number = 0;
    for (const Step& step : RandomHistory(seed, 250)) {
      SCOPED_TRACE(::testing::Message() << "seed " << seed << " step " << ++number << " " << step.name);
      const absl::StatusOr<std::string> expected = step.run(*model);
      const absl::StatusOr<std::string> actual = step.run(*store_);
      ASSERT_TRUE(actual.ok()) << actual.status();
      ASSERT_EQ(*actual, *expected);
      if (number % 60 == 0) Reopen();
      if (number % 5 == 0) {
        ASSERT_EQ(Dump(*store_), Dump(*model));
      }
    }
  }
}

}  // namespace
}  // namespace lumifold::ledger
