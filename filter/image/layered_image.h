#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "filter/image/plane.h"

namespace lumifold {

/// A picture of many named channels with metadata: the sums of a unit, a film, or the content of an OpenEXR
/// file. Channels keep the order they were added in. Names follow OpenEXR ("direct_a.R");
/// filter/image/layers.h has ours.
class LayeredImage {
 public:
  struct Channel {
    std::string name;
    Plane plane;
  };

  LayeredImage() = default;
  LayeredImage(int width, int height) : width_(width), height_(height) {}
  /// A list, such as an edge set or fragments: `rows` rows of `width` values in each channel. Its planes are
  /// packed (Plane::Packed), which pictures' are not.
  static LayeredImage List(int width, int rows);

  /// A picture, or a list if this is one, of another size and without channels.
  LayeredImage Resized(int width, int height) const;

  int width() const { return width_; }
  int height() const { return height_; }
  Rect bounds() const { return {0, 0, width_, height_}; }

  /// Adds a channel of zeros; its name must be new.
  FloatView Add(std::string_view name);
  /// The same of undefined values, to be written before they are read.
  FloatView AddUninitialized(std::string_view name);
  /// Adds a channel that takes over `plane`, which must have the picture's size; its name must be new.
  FloatView Add(std::string_view name, Plane plane);
  /// Adds LAYER.R, LAYER.G, LAYER.B (an empty layer gives plain R, G, B).
  ColorView AddColor(std::string_view layer);

  bool Has(std::string_view name) const { return Find(name) != nullptr; }
  bool HasColor(std::string_view layer) const;
  /// The channel, which must exist: call Has() first if the name comes from outside.
  FloatView Get(std::string_view name);
  ConstFloatView Get(std::string_view name) const;
  ColorView GetColor(std::string_view layer);
  ConstColorView GetColor(std::string_view layer) const;

  /// A copy of the part inside `rect`, which must lie within the picture; without metadata.
  LayeredImage Crop(const Rect& rect) const;
  /// Drops the rows from `height` on, at most all.
  void Truncate(int height);

  const std::vector<Channel>& channels() const { return channels_; }
  std::vector<Channel>& channels() { return channels_; }

  std::map<std::string, std::string>& metadata() { return metadata_; }
  const std::map<std::string, std::string>& metadata() const { return metadata_; }

 private:
  const Channel* Find(std::string_view name) const;
  Plane MakePlane() const;

  int width_ = 0;
  int height_ = 0;
  bool is_list_ = false;
  std::vector<Channel> channels_;
  std::map<std::string, std::string> metadata_;
};

/// Stacks pictures vertically. Each has the same width and the same channels in the same order, or is empty.
LayeredImage JoinRows(const std::vector<LayeredImage>& pieces);

}  // namespace lumifold
