#pragma once

#include <array>

#include "absl/time/time.h"
#include "tests/bench/farm_sim.h"

namespace lumifold::sim {

/// A small farm without troubles of its own, in which one bad machine or job is seen.
FarmSettings EvidenceFarm();
struct NamedMisdeed {
  Misdeed misdeed;
  const char* name;
};
constexpr std::array<NamedMisdeed, 6> kMisdeeds{{{Misdeed::kFailsAll, "fails all"},
                                                 {Misdeed::kFailsSlowly, "fails slowly"},
                                                 {Misdeed::kFailsOneScene, "fails one scene"},
                                                 {Misdeed::kDies, "dies"},
                                                 {Misdeed::kHangs, "hangs"},
                                                 {Misdeed::kLies, "lies"}}};
/// How long a bad machine may have the farm for itself without failing a job. One that renders other jobs is
/// believed after a minute (docs/decisions/0014-leases.md); one that renders none, never.
absl::Duration AloneFor(Misdeed misdeed);

}  // namespace lumifold::sim
