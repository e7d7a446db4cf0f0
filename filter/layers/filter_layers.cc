#include "filter/layers/filter_layers.h"

#include <utility>

#include "filter/layers/frame.h"
#include "filter/layers/product.h"
#include "filter/layers/recombination.h"
#include "filter/layers/remainder.h"

namespace lumifold::filter {
namespace {

FilteredLayer Filtered(const Product& product, LayerFilter filter, TaskPool* pool) {
  const Halves halves = HalvesOf(product, pool);
  if (halves.level == 0) return BlackLayer(product);
  Planes planes = filter(halves, product.geometry);
  RestoreUnits(product, halves.scale, pool, &planes);
  return SameForBothHalves(std::move(planes));
}

}  // namespace

Picture FilterLayers(const LayeredImage& film, LayerFilter filter, TaskPool* pool) {
  const Frame frame(film);
  const ProductParams params;
  Remainder rest = WithoutEmission(frame, pool);
  FrameChange change = NoChange(frame);
  for (const Product& product : ProductsOf(frame, params, pool)) {
    SubtractNoisy(product, {}, pool, &rest);
    AddFiltered(product, Filtered(product, filter, pool), pool, nullptr, &change);
  }
  if (!IsRounding(rest, frame, pool)) {
    const Product product =
        RemainderProduct(frame, frame.bounds(), PictureOf(frame, change, pool), params, pool, &rest);
    AddFiltered(product, Filtered(product, filter, pool), pool, nullptr, &change);
  }
  return PictureOf(frame, change, pool);
}

}  // namespace lumifold::filter
