#include "filter/layers/product.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "absl/functional/function_ref.h"
#include "filter/image/layers.h"

namespace lumifold::filter {
namespace {

constexpr float kWhollyValid = 0.999f;
constexpr float kLeastValid = 0.06f;  // one of 16 sub-samples
/// Margin of a box in pixels. Its edges are then moved outwards to whole bands and to multiples of
/// kBoxColumns, so that coarse cells lie as in the whole frame.
constexpr int kBoxMargin = 16;
constexpr int kBoxColumns = 16;

/// `part(x, y)` of every pixel of `box`.
Plane MakeMask(const Rect& box, absl::FunctionRef<float(int, int)> part) {
  Plane mask(box.width(), box.height());
  ForEachPixel(mask.width(), mask.height(),
               [&](int x, int y) { mask.At(x, y) = part(box.x0 + x, box.y0 + y); });
  return mask;
}

/// The smallest box of whole bands around the pixels where `holds` is true, and a margin; none without any.
std::optional<Rect> BoxOf(const Rect& frame, absl::FunctionRef<bool(int, int)> holds) {
  Rect box = {frame.x1, frame.y1, 0, 0};
  ForEachPixel(frame.x1, frame.y1, [&](int x, int y) {
    if (!holds(x, y)) return;
    box = {std::min(box.x0, x), std::min(box.y0, y), std::max(box.x1, x + 1), std::max(box.y1, y + 1)};
  });
  if (box.x0 >= box.x1) return std::nullopt;
  const auto down = [](int v, int unit) { return std::max(v - kBoxMargin, 0) / unit * unit; };
  const auto up = [](int v, int unit, int end) {
    return std::min((v + kBoxMargin + unit - 1) / unit * unit, end);
  };
  return Rect{down(box.x0, kBoxColumns), down(box.y0, kBandRows), up(box.x1, kBoxColumns, frame.x1),
              up(box.y1, kBandRows, frame.y1)};
}

HalvesView ViewOf(const HalvedLayer& layer, const SampleCounts& samples) {
  return {layer.a, layer.b, samples.a, samples.b};
}

Plane BinaryMask(const Rect& box, absl::FunctionRef<bool(int, int)> holds) {
  return MakeMask(box, [&](int x, int y) { return holds(x, y) ? 1.0f : 0.0f; });
}

GeometryViews GeometryOf(const SurfaceViews& surface, const Rect& box) {
  return {Crop(surface.normal, box), surface.distance.Crop(box)};
}

/// D and I of the first hit.
void AddDiffuse(const Frame& frame, const ProductParams& params, TaskPool* pool,
                std::vector<Product>* products) {
  const SurfaceViews& surface = frame.surface;
  const auto is_hit = [&](int x, int y) { return surface.distance.At(x, y) > 0; };
  const std::optional<Rect> cut = params.cuts_frame ? BoxOf(frame.bounds(), is_hit) : std::nullopt;
  const Rect box = cut.value_or(frame.bounds());
  const Plane hits = BinaryMask(box, is_hit);
  const Plane validity = MakeMask(box, [&](int x, int y) {
    const float part = is_hit(x, y) ? surface.mask.At(x, y) : 0.0f;
    return part >= kWhollyValid ? 1.0f : (part >= kLeastValid ? part : 0.0f);
  });
  const Planes geometry = GeometryFeatures(GeometryOf(surface, box), hits.view(), params.ranges, pool);
  const auto add = [&](Product::Kind kind, const HalvedLayer& layer) {
    products->push_back({.kind = kind,
                         .mean = layer.mean,
                         .factor = surface.albedo,
                         .factor_of = surface.albedo_of,
                         .halves = ViewOf(layer, frame.samples),
                         .box = box,
                         .validity = validity.Clone(),
                         .geometry = Clone(geometry),
                         .picture_light = {}});
  };
  add(Product::Kind::kDirect, frame.direct);
  add(Product::Kind::kIndirect, frame.indirect);
}

void AddLobe(const Frame& frame, const LobeViews& lobe, const GeometryRanges& ranges, TaskPool* pool,
             std::vector<Product>* products) {
  const ConstColorView& factor = lobe.factor;
  const ConstFloatView& distance = frame.surface.distance;
  const auto holds = [&](int x, int y) {
    const bool reflects = factor[0].At(x, y) > 0 || factor[1].At(x, y) > 0 || factor[2].At(x, y) > 0;
    return reflects && distance.At(x, y) > 0;
  };
  const std::optional<Rect> box = BoxOf(frame.bounds(), holds);
  if (!box.has_value()) return;
  Product product;
  product.kind = lobe.name == layers::kGlossy ? Product::Kind::kGlossy : Product::Kind::kTransmitted;
  product.mean = lobe.light.mean;
  product.factor = factor;
  product.factor_of = lobe.factor_of;
  product.halves = ViewOf(lobe.light, frame.samples);
  product.box = *box;
  product.validity = BinaryMask(*box, holds);
  const ConstFloatView validity = product.validity.view();
  if (!frame.gloss.roughness.IsEmpty())
    AppendFeature(frame.gloss.roughness.Crop(*box), ranges.roughness, validity, &product.geometry);
  for (Plane& feature : GeometryFeatures(GeometryOf(frame.surface, *box), validity, ranges, pool))
    product.geometry.push_back(std::move(feature));
  products->push_back(std::move(product));
}

/// Features of a level: the surface seen there, and the normal of the surface that it is seen in, so that
/// curved mirrors do not blur their reflections.
Planes LevelGeometry(const Frame& frame, const LevelViews& level, const Rect& box, ConstFloatView validity,
                     const GeometryRanges& ranges, TaskPool* pool) {
  Planes geometry = GeometryFeatures(GeometryOf(level.surface, box), validity, ranges, pool);
  for (const ConstFloatView& normal : Crop(frame.surface.normal, box))
    AppendFeature(normal, ranges.normal, validity, &geometry);
  return geometry;
}

bool CanBeFiltered(const LevelViews& level) {
  return !level.direct.IsEmpty() && !level.indirect.IsEmpty() && !level.surface.mask.IsEmpty() &&
         !level.surface.distance.IsEmpty() && !level.surface.normal[0].IsEmpty() &&
         !level.surface.albedo[0].IsEmpty() && !level.samples.IsEmpty();
}

void AddLevel(const Frame& frame, const LevelViews& level, const GeometryRanges& ranges, TaskPool* pool,
              std::vector<Product>* products) {
  if (!CanBeFiltered(level)) return;
  const auto holds = [&](int x, int y) {
    return level.surface.mask.At(x, y) > 0 && level.surface.distance.At(x, y) > 0 &&
           level.samples.At(x, y) > 0;
  };
  const std::optional<Rect> box = BoxOf(frame.bounds(), holds);
  if (!box.has_value()) return;
  for (const HalvedLayer* layer : {&level.direct, &level.indirect}) {
    Product product;
    product.kind = Product::Kind::kLevel;
    product.mean = layer->mean;
    product.factor = level.surface.albedo;
    product.factor_of = level.surface.albedo_of;
    product.halves = ViewOf(*layer, level.samples);
    product.box = *box;
    product.validity = BinaryMask(*box, holds);
    product.geometry = LevelGeometry(frame, level, *box, product.validity.view(), ranges, pool);
    products->push_back(std::move(product));
  }
}

HalvesView Crop(const HalvesView& halves, const Rect& box) {
  return {lumifold::Crop(halves.a, box), lumifold::Crop(halves.b, box), halves.samples_a.Crop(box),
          halves.samples_b.Crop(box)};
}

}  // namespace

std::vector<Product> ProductsOf(const Frame& frame, const ProductParams& params, TaskPool* pool) {
  std::vector<Product> products;
  AddDiffuse(frame, params, pool, &products);
  for (const LobeViews& lobe : frame.lobes) AddLobe(frame, lobe, params.ranges, pool, &products);
  for (const LevelViews& level : frame.levels) {
    if (params.has_levels) AddLevel(frame, level, params.ranges, pool, &products);
  }
  return products;
}

std::optional<Product> BlurredProduct(const Frame& frame, const BlurredPicture& picture) {
  const auto is_noisy = [&](int x, int y) { return HasNoisyFactors(frame, x, y); };
  const std::optional<Rect> box = BoxOf(frame.bounds(), is_noisy);
  if (!box.has_value()) return std::nullopt;
  Product product;
  product.kind = Product::Kind::kBlurred;
  product.mean = ViewOf(picture.mean);
  product.halves = {ViewOf(picture.a), ViewOf(picture.b), frame.samples.a, frame.samples.b};
  product.box = *box;
  product.validity = BinaryMask(*box, is_noisy);
  return product;
}

Halves HalvesOf(const Product& product, TaskPool* pool) {
  Halves halves = MakeHalves(Crop(product.halves, product.box), product.validity.view(), pool);
  halves.is_difference = product.kind == Product::Kind::kRemainder;
  halves.picture_light = product.picture_light.Clone();
  halves.is_mixed = product.is_mixed.Clone();
  return halves;
}

void RestoreUnits(const Product& product, float scale, TaskPool* pool, Planes* planes) {
  const Plane& validity = product.validity;
  for (Plane& plane : *planes) {
    ForEachPixel(pool, validity.width(), validity.height(),
                 [&](int x, int y) { plane.At(x, y) *= scale * validity.At(x, y); });
  }
}

}  // namespace lumifold::filter
