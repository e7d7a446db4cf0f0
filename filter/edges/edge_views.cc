#include "filter/edges/edge_views.h"

#include <algorithm>
#include <string>

#include "filter/image/layers.h"

namespace lumifold::filter {

EdgeViews::EdgeViews(const LayeredImage& edges)
    : x(edges.Get(layers::kPixelX)),
      y(edges.Get(layers::kPixelY)),
      distance(edges.Get(layers::kDistance)),
      id(edges.Get(layers::kObjectId)),
      mask(edges.Get(layers::kMask)),
      normal{edges.Get(layers::kNormalX), edges.Get(layers::kNormalY), edges.Get(layers::kNormalZ)},
      albedo(edges.GetColor(layers::kAlbedo)),
      emission(edges.GetColor(layers::kEmission)) {}

bool EdgeViews::IsPlain(int sample, int row) const {
  if (IsLit(sample, row) || id.At(sample, row) == 0) return true;
  return emission[0].At(sample, row) + emission[1].At(sample, row) + emission[2].At(sample, row) > 0;
}

bool EdgeViews::IsPlain(int row) const {
  for (int sample = 0; sample < id.width(); ++sample) {
    if (!IsPlain(sample, row)) return false;
  }
  return true;
}

UnknownPixels::UnknownPixels(const LayeredImage& film, float max_glossy_albedo)
    : max_glossy_albedo_(max_glossy_albedo) {
  if (film.HasColor(layers::kGlossyAlbedo)) glossy_albedo_ = film.GetColor(layers::kGlossyAlbedo);
  for (size_t i = 0; i < layers::kLevelCount; ++i) {
    for (const std::string_view count : {layers::kSamplesA, layers::kSamplesB}) {
      const std::string name = layers::OfLevel(layers::Level::Of(i), count);
      if (film.Has(name)) levels_.push_back(film.Get(name));
    }
  }
}

bool UnknownPixels::Contain(int x, int y) const {
  const auto shines = [&](const ConstFloatView& s) {
    return !s.IsEmpty() && s.At(x, y) > max_glossy_albedo_;
  };
  return std::any_of(glossy_albedo_.begin(), glossy_albedo_.end(), shines) ||
         std::any_of(levels_.begin(), levels_.end(),
                     [&](const ConstFloatView& count) { return count.At(x, y) > 0; });
}

}  // namespace lumifold::filter
