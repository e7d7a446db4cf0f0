#include "filter/layers/product.h"

#include <algorithm>
#include <array>
#include <optional>
#include <string>
#include <utility>

#include "absl/functional/function_ref.h"
#include "filter/image/layers.h"
#include "filter/layers/features.h"

namespace lumifold::filter {
namespace {

using layers::Level;
using layers::OfLevel;

constexpr float kWhollyValid = 0.999f;
constexpr float kLeastValid = 0.06f;  // of 16 sub-pixels one
/// Range of the normal of the mirror itself, so that curved mirrors do not blur what they show.
constexpr float kSigmaMirrorNormal = 0.6f;
constexpr float kSigmaRoughness = 0.1f;
/// How far a box reaches past what is in it; then its edges are moved out to whole bands and to multiples of
/// kBoxColumns, so that coarse cells lie as they would in the whole frame.
constexpr int kBoxMargin = 16;
constexpr int kBoxColumns = 16;

/// `part(x, y)` of every pixel of `box`.
Plane MakeMask(const Rect& box, absl::FunctionRef<float(int, int)> part) {
  Plane mask(box.width(), box.height());
  for (int y = 0; y < mask.height(); ++y) {
    for (int x = 0; x < mask.width(); ++x) mask.At(x, y) = part(box.x0 + x, box.y0 + y);
  }
  return mask;
}

/// The smallest box of whole bands with a margin round the pixels that `holds`; none where there are none.
std::optional<Rect> BoxOf(const Rect& frame, absl::FunctionRef<bool(int, int)> holds) {
  Rect box = {frame.x1, frame.y1, 0, 0};
  for (int y = 0; y < frame.y1; ++y) {
    for (int x = 0; x < frame.x1; ++x) {
      if (!holds(x, y)) continue;
      box = {std::min(box.x0, x), std::min(box.y0, y), std::max(box.x1, x + 1), std::max(box.y1, y + 1)};
    }
  }
  if (box.x0 >= box.x1) return std::nullopt;
  const auto down = [](int v, int unit) { return std::max(v - kBoxMargin, 0) / unit * unit; };
  const auto up = [](int v, int unit, int end) {
    return std::min((v + kBoxMargin + unit - 1) / unit * unit, end);
  };
  return Rect{down(box.x0, kBoxColumns), down(box.y0, kBandRows), up(box.x1, kBoxColumns, frame.x1),
              up(box.y1, kBandRows, frame.y1)};
}

ConstColorView NormalOf(const LayeredImage& film) {
  return {film.Get(layers::kNormalX), film.Get(layers::kNormalY), film.Get(layers::kNormalZ)};
}

/// A layer of `film` whose halves are counted by the channels `samples_a` and `samples_b`.
Product ProductOf(const LayeredImage& film, const std::string& layer, const std::string& factor,
                  std::string_view samples_a, std::string_view samples_b) {
  Product product;
  product.mean = film.GetColor(layer);
  product.factor = film.GetColor(factor);
  product.halves = {film.GetColor(layers::HalfA(layer)), film.GetColor(layers::HalfB(layer)),
                    film.Get(samples_a), film.Get(samples_b)};
  return product;
}

/// D and I of the surfaces seen first.
void AddDiffuse(const LayeredImage& film, const ProductParams& params, TaskPool* pool,
                std::vector<Product>* products) {
  const ConstFloatView mask = film.Get(layers::kMask);
  const ConstFloatView distance = film.Get(layers::kDistance);
  const auto is_hit = [&](int x, int y) { return distance.At(x, y) > 0; };
  const std::optional<Rect> cut = params.cuts_frame ? BoxOf(film.bounds(), is_hit) : std::nullopt;
  const Rect box = cut.value_or(film.bounds());
  const Plane surface = MakeMask(box, [&](int x, int y) { return is_hit(x, y) ? 1.0f : 0.0f; });
  const Plane validity = MakeMask(box, [&](int x, int y) {
    const float part = is_hit(x, y) ? mask.At(x, y) : 0.0f;
    return part >= kWhollyValid ? 1.0f : (part >= kLeastValid ? part : 0.0f);
  });
  const Planes geometry = GeometryFeatures({Crop(NormalOf(film), box), distance.Crop(box)}, surface.view(),
                                           params.sigma_normal, pool);
  for (const std::string_view layer : {layers::kDirect, layers::kIndirect}) {
    Product product = ProductOf(film, std::string(layer), std::string(layers::kAlbedo), layers::kSamplesA,
                                layers::kSamplesB);
    product.box = box;
    product.validity = validity.Clone();
    product.geometry = Clone(geometry);
    products->push_back(std::move(product));
  }
}

/// G and its like, where the film has them.
void AddGlossy(const LayeredImage& film, const layers::LobeLayer& layer, float sigma_normal, TaskPool* pool,
               std::vector<Product>* products) {
  if (!film.HasColor(layer.light) || !film.HasColor(layer.factor)) return;
  const ConstColorView glossy_albedo = film.GetColor(layer.factor);
  const ConstFloatView distance = film.Get(layers::kDistance);
  const auto holds = [&](int x, int y) {
    const bool shines =
        glossy_albedo[0].At(x, y) > 0 || glossy_albedo[1].At(x, y) > 0 || glossy_albedo[2].At(x, y) > 0;
    return shines && distance.At(x, y) > 0;
  };
  const std::optional<Rect> box = BoxOf(film.bounds(), holds);
  if (!box.has_value()) return;
  Product product = ProductOf(film, std::string(layer.light), std::string(layer.factor), layers::kSamplesA,
                              layers::kSamplesB);
  product.box = *box;
  product.is_glossy = true;
  product.validity = MakeMask(*box, [&](int x, int y) { return holds(x, y) ? 1.0f : 0.0f; });
  product.geometry = GeometryFeatures({Crop(NormalOf(film), *box), distance.Crop(*box)},
                                      product.validity.view(), sigma_normal, pool);
  if (film.Has(layers::kRoughness)) {
    AppendFeature(film.Get(layers::kRoughness).Crop(*box), kSigmaRoughness, product.validity.view(),
                  &product.geometry);
  }
  products->push_back(std::move(product));
}

/// What guides a level: what is seen there, and the normal of the surface it is seen in.
Planes LevelGeometry(const LayeredImage& film, Level level, const Rect& box, ConstFloatView validity,
                     float sigma_normal, TaskPool* pool) {
  const auto channel = [&](std::string_view name) { return film.Get(OfLevel(level, name)).Crop(box); };
  Planes geometry =
      GeometryFeatures({{channel(layers::kNormalX), channel(layers::kNormalY), channel(layers::kNormalZ)},
                        channel(layers::kDistance)},
                       validity, sigma_normal, pool);
  for (const ConstFloatView& normal : Crop(NormalOf(film), box))
    AppendFeature(normal, kSigmaMirrorNormal, validity, &geometry);
  return geometry;
}

void AddLevel(const LayeredImage& film, Level level, float sigma_normal, TaskPool* pool,
              std::vector<Product>* products) {
  if (!film.HasColor(OfLevel(level, layers::kDirect)) || !film.Has(OfLevel(level, layers::kMask))) return;
  const std::string samples_a = OfLevel(level, layers::kSamplesA);
  const std::string samples_b = OfLevel(level, layers::kSamplesB);
  const ConstFloatView mask = film.Get(OfLevel(level, layers::kMask));
  const ConstFloatView distance = film.Get(OfLevel(level, layers::kDistance));
  const ConstFloatView n_a = film.Get(samples_a);
  const ConstFloatView n_b = film.Get(samples_b);
  const auto holds = [&](int x, int y) {
    return mask.At(x, y) > 0 && distance.At(x, y) > 0 && n_a.At(x, y) + n_b.At(x, y) > 0;
  };
  const std::optional<Rect> box = BoxOf(film.bounds(), holds);
  if (!box.has_value()) return;
  for (const std::string_view layer : {layers::kDirect, layers::kIndirect}) {
    Product product =
        ProductOf(film, OfLevel(level, layer), OfLevel(level, layers::kAlbedo), samples_a, samples_b);
    product.box = *box;
    product.validity = MakeMask(*box, [&](int x, int y) { return holds(x, y) ? 1.0f : 0.0f; });
    product.is_level = true;
    product.geometry = LevelGeometry(film, level, *box, product.validity.view(), sigma_normal, pool);
    products->push_back(std::move(product));
  }
}

}  // namespace

HalvesView Crop(const HalvesView& halves, const Rect& box) {
  return {Crop(halves.a, box), Crop(halves.b, box), halves.samples_a.Crop(box), halves.samples_b.Crop(box)};
}

std::vector<Product> ProductsOf(const LayeredImage& film, const ProductParams& params, TaskPool* pool) {
  std::vector<Product> products;
  AddDiffuse(film, params, pool, &products);
  for (const layers::LobeLayer& layer : layers::kLobeLayers)
    AddGlossy(film, layer, params.sigma_normal, pool, &products);
  for (int depth = layers::kMaxDepth; depth >= 1; --depth) {
    for (const layers::Branch branch : {layers::Branch::kTransmission, layers::Branch::kReflection})
      AddLevel(film, {branch, depth}, params.sigma_normal, pool, &products);
  }
  return products;
}

}  // namespace lumifold::filter
