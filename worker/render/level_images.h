#pragma once

#include <array>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "filter/image/layered_image.h"
#include "filter/image/layers.h"

namespace lumifold::render {

/// Pictures by level, which come into being with their first pixel: a unit carries no level that none of its
/// pixels has reached.
class LevelImages {
 public:
  /// `channels` names the channels of a level.
  LevelImages(int width, int height, std::vector<std::string> (*channels)(layers::Level))
      : width_(width), height_(height), channels_(channels) {}

  /// Sets one pixel of a level; `values` are in the order of the level's channels.
  void Put(layers::Level level, int x, int y, std::span<const float> values) {
    std::optional<LayeredImage>& image = images_[level.index()];
    if (!image.has_value()) {
      image.emplace(width_, height_);
      for (const std::string& name : channels_(level)) image->Add(name);
    }
    LUMIFOLD_CHECK(values.size() == image->channels().size());
    for (size_t i = 0; i < values.size(); ++i) image->channels()[i].plane.At(x, y) = values[i];
  }

  /// Moves the channels of all levels to the end of `image`, in the order of levels.
  void MoveTo(LayeredImage* image) {
    for (std::optional<LayeredImage>& level : images_) {
      if (!level.has_value()) continue;
      for (LayeredImage::Channel& channel : level->channels())
        image->Add(channel.name, std::move(channel.plane));
    }
  }

 private:
  int width_;
  int height_;
  std::vector<std::string> (*channels_)(layers::Level);
  std::array<std::optional<LayeredImage>, layers::kLevelCount> images_;
};

}  // namespace lumifold::render
