#include "filter/manifold/denoise.h"

#include <algorithm>
#include <initializer_list>
#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/image/layers.h"
#include "filter/manifold/features.h"
#include "filter/manifold/layer_filter.h"
#include "filter/manifold/recombine.h"

namespace lumifold::filter {
namespace {

constexpr float kWhollyValid = 0.999f;
constexpr float kLeastValid = 0.06f;  // of 16 sub-pixels one

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

HalvesView HalvesOf(const LayeredImage& film, std::string_view layer) {
  return {film.GetColor(layers::HalfA(layer)), film.GetColor(layers::HalfB(layer)),
          film.Get(layers::kSamplesA), film.Get(layers::kSamplesB)};
}

/// `part(x, y)` of every pixel.
Plane MakeMask(const LayeredImage& film, absl::FunctionRef<float(int, int)> part) {
  Plane mask(film.width(), film.height());
  for (int y = 0; y < film.height(); ++y) {
    for (int x = 0; x < film.width(); ++x) mask.At(x, y) = part(x, y);
  }
  return mask;
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

using LayerFilter = Planes (*)(Halves halves, const Planes& geometry, const LayerParams& params,
                               TaskPool* pool);

/// A layer's mean and halves.
struct Layer {
  ConstColorView mean;
  HalvesView halves;
};

Layer LayerOf(const LayeredImage& film, std::string_view name) {
  return {film.GetColor(name), HalvesOf(film, name)};
}

/// One layer, filtered where `validity` says and as it was elsewhere.
Planes FilterOne(const Layer& layer, const Plane& validity, const Planes& geometry, LayerFilter filter,
                 const LayerParams& params, TaskPool* pool) {
  Halves halves = MakeHalves(layer.halves, validity.view(), pool);
  if (halves.level == 0) return CopyOf(layer.mean);  // nothing here shines
  const float scale = halves.scale;
  Planes filtered = filter(std::move(halves), geometry, params, pool);
  ForEachBand(pool, validity.height(), [&](int, int y0, int y1) {
    for (size_t c = 0; c < 3; ++c) {
      for (int y = y0; y < y1; ++y) {
        for (int x = 0; x < validity.width(); ++x) {
          float& value = filtered[c].At(x, y);
          value = validity.At(x, y) > 0 ? value * scale * validity.At(x, y) : layer.mean[c].At(x, y);
        }
      }
    }
  });
  return filtered;
}

std::array<Plane, 3> FilterLayers(const LayeredImage& film, LayerFilter filter, TaskPool* pool) {
  const ConstFloatView mask = film.Get(layers::kMask);
  const ConstFloatView distance = film.Get(layers::kDistance);
  const Plane surface = MakeMask(film, [&](int x, int y) { return distance.At(x, y) > 0 ? 1.0f : 0.0f; });
  const Plane diffuse = MakeMask(film, [&](int x, int y) {
    const float part = mask.At(x, y) * surface.At(x, y);
    return part >= kWhollyValid ? 1.0f : (part >= kLeastValid ? part : 0.0f);
  });
  const ConstColorView albedo = film.GetColor(layers::kAlbedo);
  const ConstColorView emission = film.GetColor(layers::kEmission);
  const Plane reflecting = MakeMask(
      film, [&](int x, int y) { return OnlyRadiates(albedo, emission, x, y) ? 0.0f : surface.At(x, y); });
  const LayerParams params;
  const Planes geometry = GeometryFeatures(film, surface.view(), pool);
  FilteredLayers filtered;
  filtered.direct = FilterOne(LayerOf(film, layers::kDirect), diffuse, geometry, filter, params, pool);
  filtered.indirect = FilterOne(LayerOf(film, layers::kIndirect), diffuse, geometry, filter, params, pool);
  const Remainder remainder = MakeRemainder(film, pool);
  const Layer rest = {
      ViewOf(remainder.mean),
      {ViewOf(remainder.a), ViewOf(remainder.b), film.Get(layers::kSamplesA), film.Get(layers::kSamplesB)}};
  filtered.remainder = FilterOne(rest, reflecting, geometry, filter, params, pool);
  return Recombine(film, remainder, filtered, pool);
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
                                                TaskPool* pool) {
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
  if (method == "paper") return FilterLayers(film, FilterLayerOnce, pool);
  std::array<Plane, 3> picture = FilterLayers(film, FilterLayer, pool);
  ShrinkResidual(film, pool, &picture);
  return picture;
}

}  // namespace lumifold::filter
