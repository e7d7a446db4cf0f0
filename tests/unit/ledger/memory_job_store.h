#pragma once

#include <memory>

#include "server/ledger/job_store.h"

namespace lumifold::ledger {

struct MemoryState;
std::shared_ptr<MemoryState> MakeMemoryState();

/// What a JobStore means, without a database: the model that the others are compared with. Stores of the same
/// state are the same ledger, opened again.
std::unique_ptr<JobStore> MakeMemoryJobStore(std::shared_ptr<MemoryState> state);

}  // namespace lumifold::ledger
