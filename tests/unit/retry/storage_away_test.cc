#include "proto/retry/storage_away.h"

#include <gtest/gtest.h>

#include "absl/strings/str_cat.h"

namespace lumifold::retry {
namespace {

constexpr char kLead[] = "the storage of the farm is away, try again later: ";

TEST(StorageAwayTest, CallersAreToldTheMarkAndNotTheMessage) {
  const absl::Status error =
      MarkStorageAway(absl::UnavailableError("libpq: could not connect"), "the database does not answer");
  EXPECT_EQ(error.message(), "libpq: could not connect");
  EXPECT_FALSE(IsStorageAway(error));
  const absl::Status told = ForCaller(error);
  EXPECT_EQ(told, absl::UnavailableError(absl::StrCat(kLead, "the database does not answer")));
  EXPECT_TRUE(IsStorageAway(told));
  EXPECT_EQ(StorageAway(told), told);
  EXPECT_EQ(ForCaller(told), told);
}

TEST(StorageAwayTest, OthersAreToldAsTheyAre) {
  const absl::Status stopping = absl::UnavailableError("the coordinator is stopping");
  EXPECT_EQ(ForCaller(stopping), stopping);
  EXPECT_FALSE(IsStorageAway(stopping));
  EXPECT_EQ(ForCaller(absl::OkStatus()), absl::OkStatus());
  EXPECT_EQ(StorageAway(absl::UnavailableError("DIR/x: No space left on device")),
            absl::UnavailableError(absl::StrCat(kLead, "DIR/x: No space left on device")));
}

}  // namespace
}  // namespace lumifold::retry
