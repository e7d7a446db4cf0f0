#include "filter/image/edged_image.h"

#include <algorithm>
#include <vector>

#include "filter/image/layers.h"

namespace lumifold {
namespace {

/// A coordinate of the edge set as a whole number; far outside every picture if it is not a valid one.
int PlaceOf(float place) { return place >= 0 && place < 1e9f ? static_cast<int>(place) : -1; }

void Shift(int by, FloatView places) {
  for (int row = 0; row < places.height(); ++row) {
    for (int x = 0; x < places.width(); ++x) places.At(x, row) += static_cast<float>(by);
  }
}

}  // namespace

LayeredImage EdgesInside(const LayeredImage& edges, const Rect& rect) {
  if (edges.channels().empty() || !edges.Has(layers::kPixelX) || !edges.Has(layers::kPixelY))
    return edges.Crop(edges.bounds());
  const ConstFloatView x = edges.Get(layers::kPixelX);
  const ConstFloatView y = edges.Get(layers::kPixelY);
  std::vector<int> rows;
  for (int row = 0; row < edges.height(); ++row) {
    if (rect.Contains(PlaceOf(x.At(0, row)), PlaceOf(y.At(0, row)))) rows.push_back(row);
  }
  if (rows.empty()) return {};
  LayeredImage inside = LayeredImage::List(edges.width(), static_cast<int>(rows.size()));
  for (const LayeredImage::Channel& channel : edges.channels()) {
    const FloatView out = inside.Add(channel.name);
    for (size_t i = 0; i < rows.size(); ++i)
      std::copy_n(channel.plane.Row(rows[i]), edges.width(), out.Row(static_cast<int>(i)));
  }
  MovePlaces(-rect.x0, -rect.y0, &inside);
  return inside;
}

void MovePlaces(int right, int down, LayeredImage* edges) {
  if (edges->channels().empty()) return;
  Shift(right, edges->Get(layers::kPixelX));
  Shift(down, edges->Get(layers::kPixelY));
}

}  // namespace lumifold
