#include "filter/manifold/denoise.h"

#include <algorithm>
#include <initializer_list>
#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/image/layers.h"
#include "filter/manifold/features.h"
#include "filter/manifold/layer_filter.h"
#include "filter/manifold/product.h"
#include "filter/manifold/recombine.h"

namespace lumifold::filter {
namespace {

std::vector<std::string> NamesOf(std::initializer_list<std::string_view> singles,
                                 std::initializer_list<std::string_view> colors) {
  std::vector<std::string> names(singles.begin(), singles.end());
  for (const std::string_view layer : colors) {
    for (std::string& name : layers::ColorChannels(layer)) names.push_back(std::move(name));
  }
  return names;
}

/// What every method but "none" reads.
std::vector<std::string> ChannelsToFilter() {
  std::vector<std::string> names =
      NamesOf({layers::kNormalX, layers::kNormalY, layers::kNormalZ, layers::kDistance, layers::kMask,
               layers::kSamplesA, layers::kSamplesB},
              {layers::kAlbedo, layers::kEmission});
  for (const std::string_view layer : {layers::kNoisy, layers::kDirect, layers::kIndirect}) {
    for (std::string& name : NamesOf({}, {layer, layers::HalfA(layer), layers::HalfB(layer)})) {
      names.push_back(std::move(name));
    }
  }
  return names;
}

absl::Status CheckChannels(const LayeredImage& film, const std::vector<std::string>& needed) {
  for (const std::string& name : needed) {
    if (!film.Has(name)) return absl::InvalidArgumentError(absl::StrCat("the film has no channel ", name));
  }
  return absl::OkStatus();
}

Planes CopyOf(const ConstColorView& color) {
  Planes copy = MakePlanes(3, color[0].width(), color[0].height());
  for (size_t c = 0; c < 3; ++c) CopyPlane(color[c], copy[c].view());
  return copy;
}

std::array<Plane, 3> Unfiltered(const LayeredImage& film) {
  Planes copy = CopyOf(film.GetColor(layers::kNoisy));
  return {std::move(copy[0]), std::move(copy[1]), std::move(copy[2])};
}

using LayerFilter = Planes (*)(Halves halves, const Planes& geometry, const LayerParams& params,
                               TaskPool* pool);

/// One product, filtered where its validity says and as it was elsewhere; of its box's size.
Planes FilterProduct(const Product& product, LayerFilter filter, const LayerParams& params, TaskPool* pool) {
  const Plane& validity = product.validity;
  const ConstColorView mean = Crop(product.mean, product.box);
  Halves halves = MakeHalves(Crop(product.halves, product.box), validity.view(), pool);
  if (halves.level == 0) return CopyOf(mean);  // nothing here shines
  const float scale = halves.scale;
  Planes filtered = filter(std::move(halves), product.geometry, params, pool);
  for (size_t c = 0; c < 3; ++c) {
    for (int y = 0; y < validity.height(); ++y) {
      for (int x = 0; x < validity.width(); ++x) {
        float& value = filtered[c].At(x, y);
        value = validity.At(x, y) > 0 ? value * scale * validity.At(x, y) : mean[c].At(x, y);
      }
    }
  }
  return filtered;
}

/// The remainder, on all that is hit, as one more product of factor 1.
Planes FilterRemainder(const LayeredImage& film, const Remainder& remainder, LayerFilter filter,
                       const LayerParams& params, TaskPool* pool) {
  const ConstFloatView distance = film.Get(layers::kDistance);
  Product rest;
  rest.mean = ViewOf(remainder.mean);
  rest.halves = {ViewOf(remainder.a), ViewOf(remainder.b), film.Get(layers::kSamplesA),
                 film.Get(layers::kSamplesB)};
  rest.box = film.bounds();
  rest.validity = Plane(film.width(), film.height());
  for (int y = 0; y < film.height(); ++y) {
    for (int x = 0; x < film.width(); ++x) rest.validity.At(x, y) = distance.At(x, y) > 0 ? 1.0f : 0.0f;
  }
  rest.geometry = GeometryFeatures(
      {{film.Get(layers::kNormalX), film.Get(layers::kNormalY), film.Get(layers::kNormalZ)}, distance},
      rest.validity.view(), pool);
  return FilterProduct(rest, filter, params, pool);
}

std::array<Plane, 3> FilterLayers(const LayeredImage& film, LayerFilter filter, TaskPool* pool) {
  const LayerParams params;
  const std::vector<Product> products = ProductsOf(film, pool);
  const Remainder remainder = MakeRemainder(film, products, pool);
  std::vector<Planes> filtered;
  for (const Product& product : products) filtered.push_back(FilterProduct(product, filter, params, pool));
  const Planes rest = FilterRemainder(film, remainder, filter, params, pool);
  return Recombine(film, products, filtered, remainder, rest, pool);
}

}  // namespace

const std::vector<Method>& Methods() {
  static const std::vector<Method> methods = {
      {"default", "adaptive manifolds, two passes, scale chosen per pixel by estimated error"},
      {"paper", "adaptive manifolds as published: one pass with one scale"},
      {"none", "the noisy picture itself"},
  };
  return methods;
}

absl::StatusOr<std::array<Plane, 3>> FilterFilm(const LayeredImage& film, std::string_view method,
                                                TaskPool* pool, const LayeredImage* edges) {
  const bool is_known =
      std::any_of(Methods().begin(), Methods().end(), [&](const Method& m) { return m.name == method; });
  if (!is_known)
    return absl::InvalidArgumentError(absl::StrCat("no filter is named \"", std::string(method), "\""));
  if (method == "none") {
    const absl::Status status = CheckChannels(film, NamesOf({}, {layers::kNoisy}));
    if (!status.ok()) return status;
    return Unfiltered(film);
  }
  if (const absl::Status status = CheckChannels(film, ChannelsToFilter()); !status.ok()) return status;
  if (edges != nullptr && !edges->channels().empty()) {
    const absl::Status status = CheckChannels(*edges, layers::EdgeChannels());
    if (!status.ok()) return status;
  }
  if (method == "paper") return FilterLayers(film, FilterLayerOnce, pool);
  std::array<Plane, 3> picture = FilterLayers(film, FilterLayer, pool);
  ShrinkResidual(film, pool, &picture);
  return picture;
}

}  // namespace lumifold::filter
