#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "filter/image/rect.h"
#include "lumifold/v1/image.pb.h"
#include "lumifold/v1/worker.pb.h"
#include "proto/rpc/image_codec.h"

namespace lumifold::film {

/// Channels of a pass unit, all sums: the halved layers as "direct_a.R" ... "direct_b.B"; albedo and emission
/// over all samples; and the counts of good samples, samples_a.Y and samples_b.Y.
const std::vector<std::string>& PassChannels();

/// Channels of a geometry unit, all means.
const std::vector<std::string>& GeometryChannels();

/// What a unit of one tile may take at most.
rpc::PixelLimits UnitLimits(const Rect& rect);

/// Checks that a unit has the size of its tile and the channels of its kind, in any order.
/// Errors: kInvalidArgument naming the channel or size.
absl::Status CheckUnitLayout(v1::UnitKind kind, const Rect& rect, const v1::PixelLayout& layout);

}  // namespace lumifold::film
