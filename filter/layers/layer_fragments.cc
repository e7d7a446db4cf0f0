#include "filter/layers/layer_fragments.h"

#include <algorithm>

#include "filter/layers/features.h"

namespace lumifold::filter {
namespace {

/// The fragments' light of one layer, and its factor.
struct LayerLight {
  const std::array<ConstColorView, 2>* halves = nullptr;  // null where the film has none
  std::array<float, 3> Fragment::* factor = nullptr;
};

LayerLight LightOf(const FragmentViews& views, const Product& product) {
  LayerLight light;
  if (product.kind == Product::Kind::kDirect) light = {&views.direct, &Fragment::albedo};
  if (product.kind == Product::Kind::kIndirect) light = {&views.indirect, &Fragment::albedo};
  if (product.kind == Product::Kind::kGlossy) light = {&views.glossy, &Fragment::glossy_albedo};
  return light.halves == nullptr || (*light.halves)[0][0].IsEmpty() ? LayerLight{} : light;
}

void AddPoint(const Fragment& fragment, const LayerLight& light, const GeometryRanges& ranges,
              LayerFragments* out) {
  out->factor.push_back(fragment.*light.factor);
  out->offsets.insert(out->offsets.end(), fragment.place.begin(), fragment.place.end());
  if (out->own_features > kGeometryFeatures) out->features.push_back(fragment.roughness / ranges.roughness);
  const auto geometry = GeometryFeature(fragment.normal, fragment.distance, ranges);
  out->features.insert(out->features.end(), geometry.begin(), geometry.end());
  for (size_t h = 0; h < 2; ++h) {
    out->share[h].push_back(fragment.share[h]);
    out->coverage[h].push_back(fragment.coverage[h]);
    for (size_t c = 0; c < 3; ++c) {
      out->light[h].push_back(fragment.share[h] > 0 ? UsableOr0((*light.halves)[h][c].At(0, fragment.row))
                                                    : 0.0f);
    }
  }
}

}  // namespace

LayerFragments LayerFragmentsOf(const Frame& frame, const FragmentSet& set, const Product& product,
                                const GeometryRanges& ranges) {
  LayerFragments out;
  if (set.fragments.empty() || !frame.fragments.has_value()) return out;
  const LayerLight light = LightOf(*frame.fragments, product);
  if (light.halves == nullptr) return out;
  const bool has_roughness = product.kind == Product::Kind::kGlossy && !frame.gloss.roughness.IsEmpty() &&
                             !frame.fragments->roughness.IsEmpty();
  out.own_features = kGeometryFeatures + (has_roughness ? 1 : 0);
  for (const FragmentSet::Pixel& pixel : set.pixels) {
    if (!product.box.Contains(pixel.x, pixel.y)) continue;
    LayerFragments::Pixel place{pixel.x - product.box.x0, pixel.y - product.box.y0, out.places.size(), 0};
    for (size_t i = pixel.first; i < pixel.last; ++i) {
      const Fragment& fragment = set.fragments[i];
      const std::array<float, 3>& factor = fragment.*light.factor;
      if (*std::max_element(factor.begin(), factor.end()) <= 0) continue;
      out.places.push_back({place.x, place.y});
      AddPoint(fragment, light, ranges, &out);
    }
    place.last = out.places.size();
    if (place.last > place.first) out.pixels.push_back(place);
  }
  out.noisy = out.light;
  return out;
}

void UseDominantFeatures(const LayerFragments& fragments, Planes* geometry) {
  for (const LayerFragments::Pixel& pixel : fragments.pixels) {
    const auto covered = [&](size_t i) { return fragments.coverage[0][i] + fragments.coverage[1][i]; };
    size_t most = pixel.first;
    for (size_t i = pixel.first; i < pixel.last; ++i) {
      if (covered(i) > covered(most)) most = i;
    }
    const size_t shared = geometry->size() - fragments.own_features;
    for (size_t k = 0; k < fragments.own_features; ++k)
      (*geometry)[shared + k].At(pixel.x, pixel.y) = fragments.features[most * fragments.own_features + k];
  }
}

void UseFragments(LayerFragments* fragments, Halves* halves) {
  for (std::vector<float>& light : fragments->light) {
    for (float& value : light) value /= halves->scale;
  }
  for (const LayerFragments::Pixel& pixel : fragments->pixels) {
    std::array<std::optional<std::array<float, 3>>, 2> mean;
    for (size_t h = 0; h < 2; ++h) {
      mean[h] = MeanOverPoints(*fragments, pixel, h, fragments->light[h],
                               [&](size_t i) { return fragments->share[h][i] > 0; });
    }
    for (size_t h = 0; h < 2; ++h) {
      // A half without a sample takes the other's value and weighs nothing.
      const auto& own = mean[h].has_value() ? mean[h] : mean[1 - h];
      Planes& planes = h == 0 ? halves->a : halves->b;
      for (size_t c = 0; c < 3; ++c) planes[c].At(pixel.x, pixel.y) = own.has_value() ? (*own)[c] : 0.0f;
      float covered = 0;
      for (size_t i = pixel.first; i < pixel.last; ++i)
        covered += fragments->share[h][i] > 0 ? fragments->coverage[h][i] : 0.0f;
      (h == 0 ? halves->weight_a : halves->weight_b).At(pixel.x, pixel.y) =
          mean[h].has_value() ? covered : 0.0f;
    }
    halves->weight.At(pixel.x, pixel.y) =
        std::max(halves->weight_a.At(pixel.x, pixel.y), halves->weight_b.At(pixel.x, pixel.y));
  }
}

}  // namespace lumifold::filter
