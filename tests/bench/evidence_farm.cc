#include "tests/bench/evidence_farm.h"

namespace lumifold::sim {

FarmSettings EvidenceFarm() {
  FarmSettings settings;
  settings.workers = 12;
  settings.users = 3;
  settings.jobs = 20;
  settings.units = 20'000;
  settings.frames_per_job = 2;
  settings.mean_unit = absl::Seconds(5);
  settings.straggler_share = 0;
  settings.hang_share = 0;
  settings.mean_life = absl::Hours(1000);
  settings.audit_share = 0.05;
  return settings;
}

absl::Duration AloneFor(Misdeed misdeed) {
  return misdeed == Misdeed::kFailsOneScene ? absl::Seconds(50) : absl::Minutes(5);
}

}  // namespace lumifold::sim
