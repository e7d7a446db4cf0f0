#pragma once

#include "absl/functional/function_ref.h"
#include "lumifold/v1/worker.pb.h"
#include "worker/units/unit_renderer.h"

namespace lumifold::worker {

/// Calls `send` with the messages that deliver a unit to the coordinator, in order.
void SendUnit(const v1::Lease& lease, const RenderedUnit& unit,
              absl::FunctionRef<void(v1::WorkerMessage)> send);

}  // namespace lumifold::worker
