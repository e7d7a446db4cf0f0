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

using LayerFilter = FilteredLayer (*)(Halves halves, const Planes& geometry, const LayerParams& params,
                                      const SlicePoints* points, TaskPool* pool);

/// Glossy light of more than this share stands in the way of antialiasing by sub-samples, which know T and E
/// alone.
constexpr float kMostSpecular = 0.12f;

/// What a black layer shows at the points.
FilteredPoints NothingAt(const SlicePoints* points) {
  if (points == nullptr) return {};
  const size_t count = points->pixels.size() * points->samples;
  return {std::vector<float>(3 * count, 0.0f), std::vector<float>(count, 1.0f),
          std::vector<float>(points->pixels.size(), 0.0f)};
}

/// One product, filtered where its validity says and as it was elsewhere; of its box's size, in the film's
/// unit.
FilteredLayer FilterProduct(const Product& product, LayerFilter filter, const LayerParams& params,
                            const SlicePoints* points, TaskPool* pool) {
  const Plane& validity = product.validity;
  const ConstColorView mean = Crop(product.mean, product.box);
  Halves halves = MakeHalves(Crop(product.halves, product.box), validity.view(), pool);
  if (halves.level == 0) return {CopyOf(mean), NothingAt(points)};  // nothing here shines
  const float scale = halves.scale;
  FilteredLayer filtered = filter(std::move(halves), product.geometry, params, points, pool);
  if (points != nullptr) FitToPixels(*points, filtered.planes, &filtered.points);
  ForEachBand(pool, validity.height(), [&](int, int y0, int y1) {
    for (size_t c = 0; c < 3; ++c) {
      for (int y = y0; y < y1; ++y) {
        for (int x = 0; x < validity.width(); ++x) {
          float& value = filtered.planes[c].At(x, y);
          value = validity.At(x, y) > 0 ? value * scale * validity.At(x, y) : mean[c].At(x, y);
        }
      }
    }
  });
  for (float& value : filtered.points.values) value *= scale;
  return filtered;
}

/// Whether all there is to see in a pixel is light that it radiates by itself: what is left of C beside E is
/// then exact.
bool OnlyRadiates(const ConstColorView& albedo, const ConstColorView& emission, int x, int y) {
  bool radiates = false;
  for (size_t c = 0; c < 3; ++c) {
    if (albedo[c].At(x, y) != 0) return false;
    radiates |= emission[c].At(x, y) > 0;
  }
  return radiates;
}

/// The remainder, on all that is hit and does more than radiate, as one more product of factor 1.
Planes FilterRemainder(const LayeredImage& film, const Remainder& remainder, LayerFilter filter,
                       const LayerParams& params, TaskPool* pool) {
  if (IsRounding(remainder, film, pool)) return CopyOf(ViewOf(remainder.mean));
  const ConstFloatView distance = film.Get(layers::kDistance);
  Product rest;
  rest.mean = ViewOf(remainder.mean);
  rest.halves = {ViewOf(remainder.a), ViewOf(remainder.b), film.Get(layers::kSamplesA),
                 film.Get(layers::kSamplesB)};
  rest.box = film.bounds();
  rest.validity = Plane(film.width(), film.height());
  const ConstColorView albedo = film.GetColor(layers::kAlbedo);
  const ConstColorView emission = film.GetColor(layers::kEmission);
  for (int y = 0; y < film.height(); ++y) {
    for (int x = 0; x < film.width(); ++x) {
      const bool reflects = distance.At(x, y) > 0 && !OnlyRadiates(albedo, emission, x, y);
      rest.validity.At(x, y) = reflects ? 1.0f : 0.0f;
    }
  }
  rest.geometry = GeometryFeatures(
      {{film.Get(layers::kNormalX), film.Get(layers::kNormalY), film.Get(layers::kNormalZ)}, distance},
      rest.validity.view(), pool);
  return FilterProduct(rest, filter, params, nullptr, pool).planes;
}

/// What the products after D and I, glossy light that is, add to the picture of the pixels on edges.
Planes GlossyLight(const LayeredImage& film, const std::vector<Product>& products,
                   const std::vector<Planes>& filtered) {
  Planes light = MakePlanes(3, film.width(), film.height());
  for (size_t i = 2; i < products.size(); ++i) {
    const Product& p = products[i];
    if (!p.is_glossy) continue;
    for (size_t c = 0; c < 3; ++c) {
      for (int y = p.box.y0; y < p.box.y1; ++y) {
        for (int x = p.box.x0; x < p.box.x1; ++x)
          light[c].At(x, y) = filtered[i][c].At(x - p.box.x0, y - p.box.y0) * p.factor[c].At(x, y);
      }
    }
  }
  return light;
}

std::array<Plane, 3> FilterLayers(const LayeredImage& film, const LayeredImage* edges, LayerFilter filter,
                                  TaskPool* pool) {
  const LayerParams params;
  const std::vector<Product> products = ProductsOf(film, pool);
  const EdgePoints points = edges != nullptr ? EdgePointsOf(film, *edges, kMostSpecular) : EdgePoints{};
  const bool has_points = !points.rows.empty();
  const Remainder remainder = MakeRemainder(film, products, pool);
  std::vector<Planes> filtered;
  std::array<FilteredPoints, 2> at_points;  // of D and I
  for (size_t i = 0; i < products.size(); ++i) {
    const SlicePoints* wanted = has_points && i < at_points.size() ? &points.points : nullptr;
    FilteredLayer layer = FilterProduct(products[i], filter, params, wanted, pool);
    filtered.push_back(std::move(layer.planes));
    if (wanted != nullptr) at_points[i] = std::move(layer.points);
  }
  const Planes rest = FilterRemainder(film, remainder, filter, params, pool);
  std::array<Plane, 3> picture = Recombine(film, products, filtered, remainder, rest, pool);
  if (has_points) {
    AntialiasEdges(film, *edges, points, at_points[0], at_points[1], GlossyLight(film, products, filtered),
                   pool, &picture);
  }
  return picture;
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
  if (method == "paper") return FilterLayers(film, edges, FilterLayerOnce, pool);
  std::array<Plane, 3> picture = FilterLayers(film, edges, FilterLayer, pool);
  ShrinkResidual(film, pool, &picture);
  return picture;
}

}  // namespace lumifold::filter
