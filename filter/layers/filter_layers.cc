#include "filter/layers/filter_layers.h"

#include <utility>
#include <vector>

#include "filter/layers/frame.h"
#include "filter/layers/product.h"
#include "filter/layers/recombine.h"
#include "filter/layers/remainder.h"

namespace lumifold::filter {
namespace {

Planes Filtered(const Product& product, LayerFilter filter, TaskPool* pool) {
  const Halves halves = HalvesOf(product, pool);
  if (halves.level == 0) return ClonePlanes(Crop(product.mean, product.box));  // a black layer
  Planes planes = filter(halves, product.geometry);
  RestoreUnits(product, halves.scale, pool, &planes);
  return planes;
}

}  // namespace

Picture FilterLayers(const LayeredImage& film, LayerFilter filter, TaskPool* pool) {
  const Frame frame(film);
  const ProductParams params;
  std::vector<Product> products = ProductsOf(frame, params, pool);
  const Remainder remainder = MakeRemainder(frame, products, pool);
  std::vector<FilteredProduct> filtered;
  for (Product& product : products) {
    Planes planes = Filtered(product, filter, pool);
    filtered.push_back({std::move(product), std::move(planes)});
  }
  Picture picture = Recombine(frame, filtered, pool);
  if (IsRounding(remainder, frame, pool)) return picture;
  const Product rest = RemainderProduct(frame, remainder, frame.bounds(), picture, params, pool);
  AddChange(rest.mean, Filtered(rest, filter, pool), rest.box, pool, &picture);
  return picture;
}

}  // namespace lumifold::filter
