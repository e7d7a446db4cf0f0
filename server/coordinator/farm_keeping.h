#pragma once

#include <memory>
#include <string_view>

#include "server/coordinator/farm.h"
#include "server/coordinator/resources.h"
#include "server/coordinator/roles.h"

/// Frames of which a worker keeps the units until it delivers the result (decision 33): what of that concerns
/// several parts of the farm. All of these are no-ops on frames that nobody keeps, and on jobs that are not
/// active.
namespace lumifold::server {

/// Decides whether workers may keep frames of the job, by what is known of its units.
void LetKeep(const Resources& resources, const job::JobId& job, Farm* farm);

/// A worker has rendered a unit that it keeps, and its lease has ended well. The unit counts as committed.
void CountKept(const Resources& resources, job::WorkerId worker, const KeptUnit& kept, Farm* farm);

/// The frame is rendered again: what its keeper has is lost, or not wanted.
void StopKeeping(const Resources& resources, const FrameKey& frame, std::string_view reason, Farm* farm);

/// Stops for frames that can be kept no longer.
void FollowKeeping(const Resources& resources, Farm* farm);

/// The result of the frame is here: returns what is to be recorded with it; null if nobody kept it.
std::shared_ptr<const ledger::JobCommit> EndKeeping(const FrameKey& frame, Farm* farm);

}  // namespace lumifold::server
