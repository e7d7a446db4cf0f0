#pragma once

#include <cstdint>
#include <string>
#include <tuple>
#include <vector>

#include "filter/image/layered_image.h"

namespace lumifold::film {

/// The fragments of the passes of one tile, summed by pixel and surface, in double and in the order of the
/// passes.
/// Threads: one at a time.
class TileFragments {
 public:
  /// Adds those of a pass, which are valid (see CheckFragments); all passes of a tile have the same channels.
  void Add(const LayeredImage& pass);

  /// Number of fragments.
  int64_t rows() const { return static_cast<int64_t>(places_.size()); }

  /// The means as EdgedImage::fragments of a film, with `channels`; of those that the passes do not have they
  /// are 0.
  LayeredImage Means(const std::vector<std::string>& channels) const;

 private:
  using Place = std::tuple<float, float, float>;  // y, x, surface

  /// Sums of one channel, by fragment; null where the passes do not have it.
  const std::vector<double>* Find(const std::string& channel) const;

  void FillMeans(const std::string& channel, const FloatView& means) const;
  void FillPlaces(LayeredImage* means) const;

  std::vector<Place> places_;              // ascending
  std::vector<std::string> names_;         // of the channels that are summed
  std::vector<std::vector<double>> sums_;  // by channel, then by fragment
};

}  // namespace lumifold::film
