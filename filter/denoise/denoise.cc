#include "filter/denoise/denoise.h"

#include <cmath>
#include <utility>
#include <vector>

#include "filter/denoise/picture_size.h"
#include "filter/edges/coverage_means.h"
#include "filter/edges/regression.h"
#include "filter/edges/relighting.h"
#include "filter/image/layers.h"
#include "filter/layers/features.h"
#include "filter/layers/product.h"
#include "filter/layers/recombine.h"
#include "filter/layers/seen_surface.h"

namespace lumifold::filter {
namespace {

Planes CopyOf(const ConstColorView& color) {
  Planes copy;
  for (const ConstFloatView& channel : color) copy.push_back(Clone(channel));
  return copy;
}

/// Glossy light of more than this share stands in the way of antialiasing by sub-samples, which know T and E
/// alone.
constexpr float kMaxGlossyAlbedo = 0.12f;
/// With more samples than this, EdgeMeansChange(), RelightEdges() and RegressEdges() leave nothing for light
/// read at sub-samples to better, and reading it takes two fifths of the filter's time.
constexpr float kFewSamples = 8;

/// What a black layer shows at the points.
FilteredPoints NothingAt(const SlicePoints* points) {
  if (points == nullptr) return {};
  const size_t count = points->pixels.size() * points->samples;
  return {std::vector<float>(3 * count, 0.0f), std::vector<float>(count, 1.0f),
          std::vector<float>(points->pixels.size(), 0.0f)};
}

/// The points as seen from the box's corner.
SlicePoints SeenFrom(const Rect& box, const SlicePoints& points) {
  SlicePoints moved = points;
  for (auto& [x, y] : moved.pixels) {
    x -= box.x0;
    y -= box.y0;
  }
  return moved;
}

/// One product, filtered where its validity says and as it was elsewhere; of its box's size, in the film's
/// unit. `points`, which may be null: places in the box.
FilteredLayer FilterProduct(const Product& product, LayerFilter filter, const SlicePoints* points,
                            TaskPool* pool) {
  const Plane& validity = product.validity;
  const ConstColorView mean = Crop(product.mean, product.box);
  Halves halves = MakeHalves(Crop(product.halves, product.box), validity.view(), pool);
  halves.is_difference = product.is_difference;
  halves.picture_light = product.picture_light.Clone();
  if (halves.level == 0) return {CopyOf(mean), NothingAt(points)};  // nothing here shines
  const float scale = halves.scale;
  FilteredLayer filtered = filter(std::move(halves), product.geometry, points);
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

/// Magnitude of the picture in the box over the mean, all channels together.
Plane LightOf(const std::array<Plane, 3>& picture, const Rect& box, float mean, TaskPool* pool) {
  const float share = mean > 0 ? 1.0f / (3.0f * mean) : 0.0f;
  Plane light(box.width(), box.height());
  ForEachBand(pool, light.height(), [&](int, int y0, int y1) {
    for (const Plane& channel : picture) {
      for (int y = y0; y < y1; ++y) {
        for (int x = 0; x < light.width(); ++x)
          light.At(x, y) += share * std::abs(channel.At(box.x0 + x, box.y0 + y));
      }
    }
  });
  return light;
}

/// 1 at all in the box that is hit and does more than radiate.
Plane ReflectingMask(const LayeredImage& film, const Rect& box) {
  Plane mask(box.width(), box.height());
  const ConstFloatView distance = film.Get(layers::kDistance).Crop(box);
  const ConstColorView albedo = Crop(film.GetColor(layers::kAlbedo), box);
  const ConstColorView emission = Crop(film.GetColor(layers::kEmission), box);
  for (int y = 0; y < mask.height(); ++y) {
    for (int x = 0; x < mask.width(); ++x) {
      const bool reflects = distance.At(x, y) > 0 && !OnlyRadiates(albedo, emission, x, y);
      mask.At(x, y) = reflects ? 1.0f : 0.0f;
    }
  }
  return mask;
}

Planes RemainderGeometry(const LayeredImage& film, const Rect& box, ConstFloatView validity,
                         const Assembly& assembly, TaskPool* pool) {
  GeometryViews views = {{film.Get(layers::kNormalX), film.Get(layers::kNormalY), film.Get(layers::kNormalZ)},
                         film.Get(layers::kDistance)};
  SeenSurface seen;
  if (assembly.rest_sees_levels) {
    seen = SeenSurfaceOf(film, pool);
    views = seen.geometry();
  }
  return GeometryFeatures({Crop(views.normal, box), views.distance.Crop(box)}, validity,
                          assembly.products.sigma_normal, pool);
}

/// The remainder, on all in the box that is hit and does more than radiate, as one more product of factor 1.
/// `picture`: with all other products filtered.
FilteredLayer FilterRemainder(const LayeredImage& film, const Remainder& remainder, const Rect& box,
                              const std::array<Plane, 3>& picture, LayerFilter filter, TaskPool* pool,
                              const Assembly& assembly) {
  Product rest;
  rest.is_difference = true;
  rest.picture_light = LightOf(picture, box, MeanMagnitude(film.GetColor(layers::kNoisy), pool), pool);
  rest.mean = ViewOf(remainder.mean);
  rest.halves = {ViewOf(remainder.a), ViewOf(remainder.b), film.Get(layers::kSamplesA),
                 film.Get(layers::kSamplesB)};
  rest.box = box;
  rest.validity = ReflectingMask(film, box);
  rest.geometry = RemainderGeometry(film, box, rest.validity.view(), assembly, pool);
  return FilterProduct(rest, filter, nullptr, pool);
}

/// D + I as filtered, over all of the frame; 0 where they were not.
Planes DiffuseLight(const LayeredImage& film, const Rect& box, const Planes& direct, const Planes& indirect) {
  Planes light = MakePlanes(3, film.width(), film.height());
  for (size_t c = 0; c < 3; ++c) {
    for (int y = box.y0; y < box.y1; ++y) {
      for (int x = box.x0; x < box.x1; ++x)
        light[c].At(x, y) = direct[c].At(x - box.x0, y - box.y0) + indirect[c].At(x - box.x0, y - box.y0);
    }
  }
  return light;
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

LayerParams LayerParamsOf(const DenoiseParts& parts, float reach_scale) {
  LayerParams params;
  params.reach *= reach_scale;
  params.suppresses_fireflies = parts.fireflies;
  params.pilot_manifolds.is_first_order = parts.first_order;
  params.has_second_pass = parts.second_pass;
  params.chooses = parts.choice;
  if (parts.patches) return params;
  for (PatchParams* patches : {&params.patches, &params.pilot_patches})
    patches->least_dimensions = patches->most_dimensions = 0;
  return params;
}

/// The features that are on.
Planes GuidesOf(const Planes& geometry, const DenoiseParts& parts) {
  constexpr size_t kDepth = kGeometryFeatures - 1;  // after the normal
  Planes guides;
  for (size_t i = 0; i < geometry.size(); ++i) {
    const bool is_on = i < kDepth ? parts.normals : (i > kDepth || parts.depth);
    if (is_on) guides.push_back(geometry[i].Clone());
  }
  return guides;
}

void Tell(const StepWatch& watch, DenoiseStep step) {
  if (watch) watch(step);
}

/// The step that filters layer i.
DenoiseStep StepOf(size_t i) {
  if (i == 0) return DenoiseStep::kDirect;
  return i == 1 ? DenoiseStep::kIndirect : DenoiseStep::kOtherLayers;
}

}  // namespace

std::array<Plane, 3> FilterLayers(const LayeredImage& film, const LayeredImage* edges, LayerFilter filter,
                                  TaskPool* pool, const Assembly& assembly) {
  std::vector<Product> products = ProductsOf(film, assembly.products, pool);
  if (!assembly.has_levels) std::erase_if(products, [](const Product& product) { return product.is_level; });
  const EdgePoints points = edges != nullptr
                                ? EdgePointsOf(film, *edges, kMaxGlossyAlbedo, assembly.most_samples,
                                               assembly.products.sigma_normal)
                                : EdgePoints{};
  const bool has_points = edges != nullptr && !points.rows.empty();
  const Remainder remainder = MakeRemainder(film, products, pool);
  const Rect box = products.front().box;  // of D and I
  const SlicePoints points_in_box = has_points ? SeenFrom(box, points.points) : SlicePoints{};
  Tell(assembly.watch, DenoiseStep::kSetUp);
  std::vector<Planes> filtered;
  std::array<FilteredPoints, 2> at_points;  // of D and I
  for (size_t i = 0; i < products.size(); ++i) {
    const SlicePoints* wanted = has_points && i < at_points.size() ? &points_in_box : nullptr;
    FilteredLayer layer = FilterProduct(products[i], filter, wanted, pool);
    filtered.push_back(std::move(layer.planes));
    if (wanted != nullptr) at_points[i] = std::move(layer.points);
    Tell(assembly.watch, StepOf(i));
  }
  std::array<Plane, 3> picture = Recombine(film, products, filtered, pool);
  if (!IsRounding(remainder, film, pool)) {
    const FilteredLayer rest = FilterRemainder(film, remainder, box, picture, filter, pool, assembly);
    AddChange(remainder.mean, rest.planes, box, pool, &picture);
  }
  Tell(assembly.watch, DenoiseStep::kRemainder);
  if (assembly.edge_change != nullptr) {
    *assembly.edge_change =
        EdgeMeansChange(film, edges, DiffuseLight(film, box, filtered[0], filtered[1]), pool);
    AddPlanes(*assembly.edge_change, pool, absl::MakeSpan(picture));
  }
  if (has_points) {
    AntialiasEdges(film, *edges, points, at_points[0], at_points[1], GlossyLight(film, products, filtered),
                   pool, &picture);
  }
  Tell(assembly.watch, DenoiseStep::kEdgeMeans);
  return picture;
}

std::array<Plane, 3> Denoise(const LayeredImage& film, const LayeredImage* edges, TaskPool* pool,
                             const DenoiseParts& parts) {
  const LayerParams params = LayerParamsOf(parts, ReachScale(film.width(), film.height()));
  const auto filter = [&](Halves halves, const Planes& geometry, const SlicePoints* points) {
    if (parts.normals && parts.depth) return FilterLayer(std::move(halves), geometry, params, points, pool);
    return FilterLayer(std::move(halves), GuidesOf(geometry, parts), params, points, pool);
  };
  const LayeredImage* used_edges = parts.edge_points ? edges : nullptr;
  Planes edge_change;
  std::array<Plane, 3> picture = FilterLayers(
      film, used_edges, filter, pool,
      {.has_levels = parts.levels,
       .most_samples = kFewSamples,
       .edge_change = &edge_change,
       .products = {.sigma_normal = SigmaNormal(film.width(), film.height()), .cuts_frame = true},
       .rest_sees_levels = parts.levels,
       .watch = parts.watch});
  RelightEdges(film, used_edges, kMaxGlossyAlbedo, pool, &picture);
  Tell(parts.watch, DenoiseStep::kRelighting);
  RegressEdges(film, used_edges, edge_change, pool, &picture);
  Tell(parts.watch, DenoiseStep::kRegression);
  if (parts.convergence) ShrinkResidual(film, pool, &picture);
  Tell(parts.watch, DenoiseStep::kConvergence);
  return picture;
}

std::array<Plane, 3> DenoiseAsPublished(const LayeredImage& film, const LayeredImage* edges, TaskPool* pool) {
  const auto filter = [pool](Halves halves, const Planes& geometry, const SlicePoints* points) {
    return FilterLayerOnce(std::move(halves), geometry, PatchParams{}, OnePassParams{}, points, pool);
  };
  return FilterLayers(film, edges, filter, pool);
}

}  // namespace lumifold::filter
