#pragma once

#include <bitset>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "filter/image/edged_image.h"
#include "filter/image/layers.h"
#include "filter/image/rect.h"
#include "lumifold/v1/image.pb.h"
#include "lumifold/v1/worker.pb.h"
#include "proto/rpc/image_codec.h"

namespace lumifold::film {

/// Channels every pass unit has, all sums: the halved layers as "direct_a.R" ... "direct_b.B"; the whole ones
/// over all samples; and the counts of good samples, samples_a.Y and samples_b.Y. Those of levels
/// (layers::LevelPassChannels) come on top, each level's all or none.
const std::vector<std::string>& PassChannels();

/// Channels every geometry unit has, all means. Those of levels (layers::LevelFeatureChannels) come on top.
const std::vector<std::string>& GeometryChannels();

/// Levels, each by its Level::index().
using LevelSet = std::bitset<layers::kLevelCount>;

/// The levels a unit of this layout carries.
LevelSet LevelsOf(v1::UnitKind kind, const v1::PixelLayout& layout);

/// What the pixels of a unit of one tile may take at most, and its edge set.
rpc::PixelLimits UnitLimits(const Rect& rect);
rpc::PixelLimits EdgeLimits(const Rect& rect);

/// Checks that a unit has the size of its tile and the channels of its kind, in any order.
/// Errors: kInvalidArgument naming the channel or size.
absl::Status CheckUnitLayout(v1::UnitKind kind, const Rect& rect, const v1::PixelLayout& layout);

/// Checks an edge set of a tile: none at all; or the channels and width it must have, and its pixels within
/// the tile, in the order of its rows, each once.
/// Errors: kInvalidArgument naming the channel, size or row.
absl::Status CheckEdges(const Rect& rect, const LayeredImage& edges);

}  // namespace lumifold::film
