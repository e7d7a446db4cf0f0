#pragma once

#include "lumifold/v1/worker.pb.h"

namespace lumifold::film {

/// The statistics that are stored of a unit: the text of a worker is bounded, and fields that are not known
/// are dropped.
v1::UnitStats StoredStats(const v1::UnitStats& delivered);

}  // namespace lumifold::film
