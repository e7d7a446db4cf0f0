#pragma once

#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "filter/image/edged_image.h"
#include "filter/image/level_images.h"
#include "filter/image/rect.h"
#include "server/film/tile_fragments.h"
#include "server/film/unit_layout.h"

namespace lumifold::film {

/// Sums of the passes of one tile, in double, by channel.
/// Threads: one at a time.
class TileSums {
 public:
  /// Adds the sums of a pass; all passes have the same size.
  void Add(const EdgedImage& pass);
  bool Has(std::string_view channel) const { return sums_.find(channel) != sums_.end(); }
  /// Sums of a channel in row-major order; the channel must exist.
  const std::vector<double>& Of(std::string_view channel) const;
  const TileFragments& fragments() const { return fragments_; }

 private:
  std::map<std::string, std::vector<double>, std::less<>> sums_;
  TileFragments fragments_;
};

/// Assembles the film of a frame, or of a part of it, from the tiles that have pixels there. The film does
/// not depend on the order of the tiles, nor on the parts a frame is assembled in.
/// Threads: safe concurrently for different tiles; call Take() after all tiles.
///
/// Channels: for each layer of layers::kHalved the mean of all samples and of each half; layers::kWhole; of
/// layers that
///         the units do not have D, I, T and E are 0, G and S are absent. The
///         sample counts; the channels of geometry units. The same for each level, where D and I are means
///         over the samples that reached the level, T and E are means over all samples of the pixel, and a
///         tile without the level has zeros. edges: those of all geometry units, in the order of the frame's
///         rows. fragments: those of all passes with equal pixel and surface as one, see
///         FilmFragmentChannels.
/// Edges:  where a half has no finite sample its mean and its count are 0.
class FilmBuilder {
 public:
  /// A whole frame with the levels that its tiles have.
  FilmBuilder(int width, int height, const UnitModel& model = {});
  /// The part of a frame inside `part`, with at least `levels`.
  FilmBuilder(const Rect& part, const LevelSet& levels, const UnitModel& model = {});

  // Tiles are in frame coordinates. Pixels outside the part are ignored.

  /// Sets the means of a tile, those of its fragments too; call it once for each tile.
  void SetMeans(const Rect& rect, const TileSums& sums);
  /// Sets the geometry of a tile; the layout of `geometry` is valid.
  void SetGeometry(const Rect& rect, const LayeredImage& geometry);
  /// Adds the edge set of a tile, which is valid.
  void AddEdges(const LayeredImage& edges);

  /// The assembled part of the film; positions in its edge set are relative to the part's corner.
  EdgedImage Take();

 private:
  /// The channels of a level.
  LayeredImage* LevelOf(layers::Level level);
  void SetLevelMeans(const Rect& rect, const TileSums& sums, layers::Level level);

  const Rect part_;
  const UnitModel model_;
  LayeredImage film_;
  absl::Mutex mutex_;
  LevelImages levels_ ABSL_GUARDED_BY(mutex_);
  std::vector<LayeredImage> edges_ ABSL_GUARDED_BY(mutex_);
  std::vector<LayeredImage> fragments_ ABSL_GUARDED_BY(mutex_);
};

/// The channels of the fragments of a film of units of this model: as in its pixels, light that the units do
/// not have is 0, and G and S are absent. None if the units have no fragments.
std::vector<std::string> FilmFragmentChannels(const UnitModel& model);

}  // namespace lumifold::film
