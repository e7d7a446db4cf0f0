#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "server/ledger/job_store.h"

namespace lumifold::ledger {

/// A call of a JobStore with fixed arguments; `run` returns its outcome as text.
struct Step {
  std::string name;
  std::function<absl::StatusOr<std::string>(JobStore&)> run;
};

/// Random calls about a few jobs, owners, frames and units, so that they meet each other.
std::vector<Step> RandomHistory(uint64_t seed, int steps);

/// The life of two jobs, in few calls: each kind of write at least once.
std::vector<Step> ShortHistory();

/// All that can be asked of a store, as text.
std::string Dump(JobStore& store);

}  // namespace lumifold::ledger
