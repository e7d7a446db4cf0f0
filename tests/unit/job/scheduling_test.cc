#include "server/job/scheduling.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <string>
#include <utility>
#include <vector>

namespace lumifold::job {
namespace {

TEST(Scheduling, TheLimitsAreAllowed) {
  v1::Scheduling scheduling;
  scheduling.set_priority(-100);
  scheduling.set_user(std::string(255, 'u'));
  scheduling.set_audit_share(1);
  for (int i = 0; i < 32; ++i) scheduling.add_tags(std::string(64, 't'));
  for (int i = 0; i < 64; ++i) scheduling.add_after("j-1");
  EXPECT_EQ(NormaliseScheduling(scheduling)->SerializeAsString(), scheduling.SerializeAsString());
}

TEST(Scheduling, AJobWithoutAUserIsAnonymous) { EXPECT_EQ(NormaliseScheduling({})->user(), "anonymous"); }

TEST(Scheduling, EachFieldHasALimitAndTheErrorNamesIt) {
  const std::vector<std::pair<std::function<void(v1::Scheduling&)>, std::string>> cases = {
      {[](auto& s) { s.set_priority(101); }, "priority is 101, not -100 to 100"},
      {[](auto& s) { s.set_user(std::string(256, 'u')); }, "user has 256 bytes, not 1 to 255"},
      {[](auto& s) { s.set_user(std::string("a\0b", 3)); }, "user has a NUL character"},
      {[](auto& s) { s.set_name(std::string(256, 'n')); }, "name has 256 bytes, not 0 to 255"},
      {[](auto& s) { s.set_numeric_class(std::string(257, 'c')); },
       "numeric_class has 257 bytes, not 0 to 256"},
      {[](auto& s) { s.add_tags(""); }, "tags has 0 bytes, not 1 to 64"},
      {[](auto& s) {
         for (int i = 0; i < 33; ++i) s.add_tags("t");
       },
       "tags has 33 entries, allowed are 32"},
      {[](auto& s) {
         for (int i = 0; i < 65; ++i) s.add_after("j-1");
       },
       "after has 65 entries, allowed are 64"},
      {[](auto& s) { s.set_max_leases(-1); }, "max_leases is -1, not 0 (no limit) or more"},
      {[](auto& s) { s.set_audit_share(std::nan("")); }, "audit_share is nan, not 0 to 1"},
      {[](auto& s) { s.set_audit_share(1.5); }, "audit_share is 1.5, not 0 to 1"},
  };
  for (const auto& [spoil, error] : cases) {
    v1::Scheduling scheduling;
    spoil(scheduling);
    EXPECT_EQ(NormaliseScheduling(scheduling).status(), absl::InvalidArgumentError(error));
  }
}

}  // namespace
}  // namespace lumifold::job
