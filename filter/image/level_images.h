#pragma once

#include <array>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "filter/image/layered_image.h"
#include "filter/image/layers.h"

namespace lumifold {

/// One picture per level, all of one size, created on first use: levels that no pixel reaches take no memory.
class LevelImages {
 public:
  /// `channels` gives the channel names of a level.
  LevelImages(int width, int height, std::function<std::vector<std::string>(layers::Level)> channels)
      : width_(width), height_(height), channels_(std::move(channels)) {}

  /// The level's picture; zeros if it is new.
  LayeredImage& At(layers::Level level) {
    std::optional<LayeredImage>& image = images_[level.index()];
    if (!image.has_value()) {
      image.emplace(width_, height_);
      for (const std::string& name : channels_(level)) image->Add(name);
    }
    return *image;
  }

  /// Moves the channels of all levels to the end of `image`, which must have their size, in the order of
  /// levels.
  void MoveTo(LayeredImage* image) {
    for (std::optional<LayeredImage>& level : images_) {
      if (!level.has_value()) continue;
      for (LayeredImage::Channel& channel : level->channels())
        image->Add(channel.name, std::move(channel.plane));
      level.reset();
    }
  }

 private:
  int width_;
  int height_;
  std::function<std::vector<std::string>(layers::Level)> channels_;
  std::array<std::optional<LayeredImage>, layers::kLevelCount> images_;
};

}  // namespace lumifold
