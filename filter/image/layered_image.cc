#include "filter/image/layered_image.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/image/layers.h"

namespace lumifold {

LayeredImage LayeredImage::List(int width, int rows) {
  LayeredImage list(width, rows);
  list.is_list_ = true;
  return list;
}

LayeredImage LayeredImage::Resized(int width, int height) const {
  return is_list_ ? List(width, height) : LayeredImage(width, height);
}

/// Of undefined values.
Plane LayeredImage::MakePlane() const {
  return is_list_ ? Plane::Packed(width_, height_) : Plane::Uninitialized(width_, height_);
}

FloatView LayeredImage::Add(std::string_view name) {
  if (!is_list_) return Add(name, Plane(width_, height_));
  Plane plane = MakePlane();
  plane.Fill(0);
  return Add(name, std::move(plane));
}

FloatView LayeredImage::AddUninitialized(std::string_view name) { return Add(name, MakePlane()); }

FloatView LayeredImage::Add(std::string_view name, Plane plane) {
  LUMIFOLD_CHECK(!Has(name));
  LUMIFOLD_CHECK(plane.width() == width_ && plane.height() == height_);
  channels_.push_back({std::string(name), std::move(plane)});
  return channels_.back().plane.view();
}

ColorView LayeredImage::AddColor(std::string_view layer) {
  const auto names = layers::ColorChannels(layer);
  return {Add(names[0]), Add(names[1]), Add(names[2])};
}

bool LayeredImage::HasColor(std::string_view layer) const {
  const auto names = layers::ColorChannels(layer);
  return Has(names[0]) && Has(names[1]) && Has(names[2]);
}

const LayeredImage::Channel* LayeredImage::Find(std::string_view name) const {
  for (const Channel& channel : channels_) {
    if (channel.name == name) return &channel;
  }
  return nullptr;
}

ConstFloatView LayeredImage::Get(std::string_view name) const {
  const Channel* channel = Find(name);
  LUMIFOLD_CHECK(channel != nullptr);
  return channel->plane.view();
}

FloatView LayeredImage::Get(std::string_view name) {
  const Channel* channel = Find(name);
  LUMIFOLD_CHECK(channel != nullptr);
  return const_cast<Channel*>(channel)->plane.view();  // found in our own non-const vector
}

ConstColorView LayeredImage::GetColor(std::string_view layer) const {
  const auto names = layers::ColorChannels(layer);
  return {Get(names[0]), Get(names[1]), Get(names[2])};
}

ColorView LayeredImage::GetColor(std::string_view layer) {
  const auto names = layers::ColorChannels(layer);
  return {Get(names[0]), Get(names[1]), Get(names[2])};
}

LayeredImage LayeredImage::Crop(const Rect& rect) const {
  LayeredImage part = Resized(rect.width(), rect.height());
  for (const Channel& channel : channels_) {
    Plane plane = part.MakePlane();
    CopyPlane(channel.plane.view().Crop(rect), plane.view());
    part.Add(channel.name, std::move(plane));
  }
  return part;
}

void LayeredImage::Truncate(int height) {
  for (Channel& channel : channels_) channel.plane.Truncate(height);
  height_ = height;
}

LayeredImage JoinRows(const std::vector<LayeredImage>& pieces) {
  int height = 0;
  const LayeredImage* sample = nullptr;
  for (const LayeredImage& piece : pieces) {
    height += piece.height();
    if (!piece.channels().empty()) sample = &piece;
  }
  if (sample == nullptr) return {};
  LayeredImage joined = sample->Resized(sample->width(), height);
  for (size_t i = 0; i < sample->channels().size(); ++i) {
    const FloatView out = joined.Add(sample->channels()[i].name);
    int y = 0;
    for (const LayeredImage& piece : pieces) {
      if (piece.channels().empty()) continue;
      CopyPlane(piece.channels()[i].plane.view(), out.Crop({0, y, piece.width(), y + piece.height()}));
      y += piece.height();
    }
  }
  return joined;
}

}  // namespace lumifold
