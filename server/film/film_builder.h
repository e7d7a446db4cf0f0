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
#include "server/film/unit_layout.h"

namespace lumifold::film {

/// Sums of one tile over its passes, in double, by channel. Threads: one at a time.
class TileSums {
 public:
  /// Adds a pass's sums; all passes have one size.
  void Add(const LayeredImage& pass);
  bool Has(std::string_view channel) const { return sums_.find(channel) != sums_.end(); }
  /// The tile's rows one after another; the channel must be there.
  const std::vector<double>& Of(std::string_view channel) const;

 private:
  std::map<std::string, std::vector<double>, std::less<>> sums_;
};

/// Puts a frame's film, or a part of it, together from the tiles that have pixels there. What comes out does
/// not depend on the order they come in, nor on how the frame was cut. Threads: safe concurrently for
/// different tiles; Take() when all are in.
///
/// Channels: for each of layers::kHalved the mean and its halves' means, layers::kWhole, the counts, the
///         channels of geometry units; and the same of levels, where D and I are means over the samples
///         counted there, T and E means over all samples of the pixel, and a tile without the level has
///         zeros. edges: those of all geometry units, in the order of the frame's rows.
/// Edges:  where a half has no good sample its mean is 0 and its count 0.
class FilmBuilder {
 public:
  /// A whole frame with the levels its tiles turn out to have.
  FilmBuilder(int width, int height);
  /// The part of a frame inside `part`, with `levels` at least.
  FilmBuilder(const Rect& part, const LevelSet& levels);

  // Tiles are in the frame's pixels. What lies outside the part is left out.

  /// Writes the means of a tile.
  void SetMeans(const Rect& rect, const TileSums& sums);
  /// Takes over a tile's geometry, a unit of valid layout.
  void SetGeometry(const Rect& rect, const LayeredImage& geometry);
  /// Takes over a tile's edge set, which is valid.
  void AddEdges(const LayeredImage& edges);

  /// The part of the film, its edge set with places from the part's corner.
  EdgedImage Take();

 private:
  /// The level's channels of the film.
  LayeredImage* LevelOf(layers::Level level);
  void SetLevelMeans(const Rect& rect, const TileSums& sums, layers::Level level);

  const Rect part_;
  LayeredImage film_;
  absl::Mutex mutex_;
  LevelImages levels_ ABSL_GUARDED_BY(mutex_);
  std::vector<LayeredImage> edges_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace lumifold::film
