#pragma once

#include <cstdint>
#include <vector>

#include "server/commit/committer.h"
#include "server/coordinator/farm_state.h"
#include "server/coordinator/resources.h"

namespace lumifold::server {

/// What the outcome of commits changes. On the committer's thread.
class CommitResults final : public Committer::Listener {
 public:
  /// Both must outlive it.
  CommitResults(const Resources* resources, FarmState* state) : resources_(resources), state_(state) {}

  bool IsWanted(const job::JobId& job) override;
  void OnCommitted(const std::vector<AcceptedUnit>& units, const absl::Status& status) override;
  void OnUnitsLost(const job::JobId& job, int32_t frame, const absl::Status& cause,
                   const absl::StatusOr<std::vector<ledger::UnitRecord>>& lost) override;
  void OnUnitsDiscarded(const FrameKey& frame, const std::vector<job::UnitKey>& units,
                        const absl::StatusOr<std::vector<ledger::UnitRecord>>& lost) override;
  void OnStorageAvailable() override;

 private:
  const Resources* const resources_;
  FarmState* const state_;
};

}  // namespace lumifold::server
