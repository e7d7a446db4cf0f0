#include "filter/layers/recombine.h"

namespace lumifold::filter {

Picture Recombine(const Frame& frame, const std::vector<FilteredProduct>& filtered, TaskPool* pool) {
  Picture picture;
  for (Plane& plane : picture) plane = Plane(frame.width, frame.height);
  for (const auto& [product, planes] : filtered) {
    const Rect& box = product.box;
    for (size_t c = 0; c < 3; ++c) {
      ForEachPixel(pool, box.width(), box.height(), [&, &p = product, &after = planes](int x, int y) {
        const float change = after[c].At(x, y) - p.mean[c].At(box.x0 + x, box.y0 + y);
        picture[c].At(box.x0 + x, box.y0 + y) += UsableOr0(change * p.factor[c].At(box.x0 + x, box.y0 + y));
      });
    }
  }
  for (size_t c = 0; c < 3; ++c) {
    ForEachPixel(pool, frame.width, frame.height, [&](int x, int y) {
      float& value = picture[c].At(x, y);
      value = UsableOr0(UsableOr0(frame.combined.mean[c].At(x, y)) + value);
    });
  }
  return picture;
}

void AddChange(const ConstColorView& before, const Planes& after, const Rect& box, TaskPool* pool,
               Picture* picture) {
  for (size_t c = 0; c < 3; ++c) {
    ForEachPixel(pool, box.width(), box.height(), [&](int x, int y) {
      const float change = after[c].At(x, y) - before[c].At(box.x0 + x, box.y0 + y);
      float& value = (*picture)[c].At(box.x0 + x, box.y0 + y);
      value = UsableOr0(value + UsableOr0(change));
    });
  }
}

}  // namespace lumifold::filter
