#pragma once

#include <bitset>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "filter/image/layers.h"
#include "filter/image/rect.h"
#include "filter/image/tile_samples.h"
#include "lumifold/v1/image.pb.h"
#include "lumifold/v1/job.pb.h"
#include "lumifold/v1/worker.pb.h"
#include "proto/rpc/checksum.h"
#include "proto/rpc/image_codec.h"
#include "server/film/plane_rows.h"

namespace lumifold::film {

/// The layers besides C, and the levels, that the units of a job may have: those of its plan. Without glossy
/// neither G nor S.
struct UnitModel {
  layers::Carried carried;
  int levels = layers::kMaxDepth;  // greatest depth
  bool has_matte = false;          // layers::kMatte

  /// Whether units have this layer of layers::kHalved or layers::kWhole.
  bool Has(std::string_view layer) const { return carried.Has(layer); }
};

UnitModel ModelOf(const v1::JobSpec& spec);

/// Channels of every pass unit, all of them sums: the layers with halves as "direct_a.R" ... "direct_b.B";
/// the layers without halves; the counts of finite samples, samples_a.Y and samples_b.Y; and layers::kMatte
/// if the model has it. A unit may also
/// have levels (layers::LevelPassChannels), each with all of its channels.
std::vector<std::string> PassChannels(const UnitModel& model = {});

/// Channels of every geometry unit, all of them means but layers::kBlur. A unit may also have levels
/// (layers::LevelFeatureChannels).
std::vector<std::string> GeometryChannels(const UnitModel& model = {});

/// Channels of the fragments of a pass unit, all of them sums but pixel.X, pixel.Y and surface.Y; none if the
/// model has no light of surfaces: then the units have no fragments.
std::vector<std::string> PassFragmentChannels(const UnitModel& model = {});

/// Set of levels, by Level::index().
using LevelSet = std::bitset<layers::kLevelCount>;

/// The levels of a unit with this layout.
LevelSet LevelsOf(v1::UnitKind kind, const v1::PixelLayout& layout);

/// Maximum size of the pixels of a unit of one tile, and of its list: the edge set of a geometry unit, the
/// fragments of a pass.
rpc::PixelLimits UnitLimits(const Rect& rect);
rpc::PixelLimits ListLimits(v1::UnitKind kind, const Rect& rect);

/// Checks that a unit has the size of its tile and exactly the channels of its kind, in any order, and no
/// deeper levels than the model.
/// Errors: kInvalidArgument naming the channel, level or size.
absl::Status CheckUnitLayout(v1::UnitKind kind, const Rect& rect, const v1::PixelLayout& layout,
                             const UnitModel& model = {});

/// Checks the values of a unit whose layout is valid: all are finite; each sample count of a pass is a whole
/// number from 0 to the number of samples that its half has there in `samples`; the counts and the bad
/// samples of `stats` add up to the samples of the pass; the numbers of `stats` are not negative. `rect` and
/// `samples` are those of the lease. Reads every value once, in place. Adds all values, as float32, to
/// `checksum`, which may be null.
/// Errors: kInvalidArgument naming the channel, the pixel in the frame, and the value; that of
/// PlaneRows::status.
absl::Status CheckUnitValues(v1::UnitKind kind, const Rect& rect, const TileSamples& samples,
                             PlaneRows pixels, const v1::UnitStats& stats,
                             rpc::RunningChecksum* checksum = nullptr);

/// Checks the edge set of a tile. It is empty, or it has the required channels and width, all values are
/// finite, and its pixels are inside the tile, in row-major order, each once. Adds all values, as float32, to
/// `checksum`, which may be null.
/// Errors: kInvalidArgument naming the channel, size or row; that of PlaneRows::status.
absl::Status CheckEdges(const Rect& rect, PlaneRows edges, rpc::RunningChecksum* checksum = nullptr);

/// Checks the fragments of a pass over a tile. The list is empty, or it has the channels of the model and is
/// 1 wide; all values are finite; its pixels are inside the tile, in row-major order, at most kMaxFragments
/// times each; the surfaces of a pixel are whole numbers in [1, 2^24) and ascend; counts are whole numbers,
/// not both 0. Adds all values, as float32, to `checksum`, which may be null.
/// Errors: kInvalidArgument naming the channel, size or row; that of PlaneRows::status.
absl::Status CheckFragments(const Rect& rect, const UnitModel& model, PlaneRows fragments,
                            rpc::RunningChecksum* checksum = nullptr);

/// Checks that the fragments of a pixel have no more samples of a half together than the pixel has. Both are
/// valid.
/// Errors: kInvalidArgument naming the channel and the pixel.
absl::Status CheckFragmentCounts(const Rect& rect, PlaneRows fragments, PlaneRows pixels);

}  // namespace lumifold::film
