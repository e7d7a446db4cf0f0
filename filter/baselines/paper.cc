#include "filter/baselines/paper.h"

#include <array>
#include <utility>
#include <vector>

#include "filter/baselines/manifolds_color.h"
#include "filter/image/edged_image.h"
#include "filter/layers/features.h"
#include "filter/layers/frame.h"
#include "filter/layers/guide.h"
#include "filter/layers/halves.h"
#include "filter/layers/product.h"
#include "filter/layers/recombination.h"
#include "filter/manifold/manifold_filter.h"
#include "filter/manifold/nlm_space.h"

namespace lumifold::filter {
namespace {

constexpr PatchParams kPatches = {.radius = 3, .least_dimensions = 6, .most_dimensions = 6};
/// Range of patches of pictures with white at 1, and length of the window of a patch of 7x7 colours, both in
/// the programs of Gastal & Oliveira. Our window has length 1.
constexpr float kTheirRange = 0.35f;
constexpr float kTheirWindow = 3.76f;

/// The sigmas of the filter.
struct Sigmas {
  float reach_px;
  float patches;  // of NLM coordinates, over the layer's noise; 0: kTheirRange
};

float RangeOfPatches(const Sigmas& sigmas, const Halves& halves, TaskPool* pool) {
  if (sigmas.patches > 0) return sigmas.patches * PositiveNoise(halves, pool);
  return kTheirRange / kTheirWindow * halves.level;
}

/// The features of all pixels of a layer: NLM coordinates, then normal and depth; not the mirror's of a
/// level.
JointGuide GuideOf(const Halves& halves, const Planes& mean, const Planes& geometry, const Sigmas& sigmas,
                   TaskPool* pool) {
  const PatchBasis basis = FitPatchBasis(mean, halves.weight.view(), kPatches, pool);
  return MakeJointGuide(Clone(mean), basis, RangeOfPatches(sigmas, halves, pool),
                        absl::MakeConstSpan(geometry).first(kGeometryFeatures));
}

/// The sub-samples of the edge pixels.
struct SubPixels {
  SlicePoints points;        // with features of geometry
  std::vector<char> is_lit;  // for each point: whether it has D and I
};

SubPixels SubPixelsOf(const Frame& frame) {
  SubPixels out;
  out.points.own_features = kGeometryFeatures;
  out.points.pixel_divisor = 1;
  if (!frame.edges.has_value()) return out;
  const EdgeViews& edges = *frame.edges;
  edges.ForEachPixel(frame.bounds(), [&](int row, int x, int y) {
    for (int j = 0; j < kSubSamples; ++j) {
      out.points.pixels.push_back({x, y});
      out.is_lit.push_back(edges.IsLit(j, row) ? 1 : 0);
      std::array<float, kGeometryFeatures> feature = {};
      if (edges.IsLit(j, row))
        feature = GeometryFeature(
            {edges.normal[0].At(j, row), edges.normal[1].At(j, row), edges.normal[2].At(j, row)},
            edges.distance.At(j, row), GeometryRanges{});
      out.points.features.insert(out.points.features.end(), feature.begin(), feature.end());
    }
  });
  return out;
}

/// Sets each edge pixel to `scale` times the mean over its sub-samples.
void AverageSubPixels(const SubPixels& sub_pixels, const SlicedPoints& sliced, float scale, Planes* planes) {
  constexpr size_t kSamples = kSubSamples;
  for (size_t first = 0; first < sub_pixels.points.pixels.size(); first += kSamples) {
    std::array<float, 3> sum = {0, 0, 0};
    int lit = 0;
    int found = 0;
    for (size_t i = first; i < first + kSamples; ++i) {
      if (sub_pixels.is_lit[i] == 0) continue;
      ++lit;
      if (!(sliced.weights[i] > 0)) continue;
      ++found;
      for (size_t c = 0; c < 3; ++c) sum[c] += sliced.values[3 * i + c];
    }
    if (found == 0) continue;
    const float share = scale * static_cast<float>(lit) / static_cast<float>(kSubSamples * found);
    const auto [x, y] = sub_pixels.points.pixels[first];
    for (size_t c = 0; c < 3; ++c) (*planes)[c].At(x, y) = share * sum[c];
  }
}

/// Filters a layer. `sub_pixels`: of the product's box; null: no pixel has any.
FilteredLayer Filtered(const Product& product, const Sigmas& sigmas, const SubPixels* sub_pixels,
                       TaskPool* pool) {
  const Halves halves = HalvesOf(product, pool);
  if (halves.level == 0) return BlackLayer(product);
  const Planes mean = Combine(halves.a, halves.b, halves.share_a.view(), pool);
  const JointGuide guide = GuideOf(halves, mean, product.geometry, sigmas, pool);
  ManifoldParams params;
  params.sigma_s = sigmas.reach_px;
  params.height = TreeHeight(sigmas.reach_px, kTheirRange, /*has_patches=*/true);
  const GuidedFiltering filtering = {
      mean, nullptr, guide, 1, halves.weight.view(), sub_pixels != nullptr ? &sub_pixels->points : nullptr};
  ManifoldResult result = std::move(FilterGuided({&filtering, 1}, params, params.sigma_s, pool).front());
  RestoreUnits(product, halves.scale, pool, &result.filtered);
  if (sub_pixels != nullptr) AverageSubPixels(*sub_pixels, result.points, halves.scale, &result.filtered);
  return SameForBothHalves(std::move(result.filtered));
}

bool IsOfFirstHit(const Product& product) {
  return product.kind == Product::Kind::kDirect || product.kind == Product::Kind::kIndirect;
}

Picture Filter(const FilmView& film, absl::Span<const float> values, TaskPool* pool) {
  const Sigmas sigmas = {values[0], values[1]};
  const Frame frame(film.pixels, film.edges);
  const SubPixels sub_pixels = SubPixelsOf(frame);
  FrameChange change = NoChange(frame);
  for (const Product& product : ProductsOf(frame, {}, pool)) {
    if (!IsOfFirstHit(product) && product.kind != Product::Kind::kLevel) continue;
    // Levels have no sub-samples. The box of the first hit is the frame, as the edge set's coordinates need.
    const FilteredLayer layer =
        Filtered(product, sigmas, IsOfFirstHit(product) ? &sub_pixels : nullptr, pool);
    AddFiltered(product, layer, pool, nullptr, &change);
  }
  return PictureOf(frame, change, pool);
}

}  // namespace

Baseline PaperBaseline() {
  return {
      .info =
          {.name = "paper",
           .summary = "adaptive manifolds on direct and indirect light, edges from sub-samples",
           .source = "Gruzdev et al. 2015, which gives no ranges: ours, or that of Gastal & Oliveira 2012",
           .parameters = {{"sigma_s", "reach in pixels", 16, {4, 8, 16}, 1, 64},
                          {"sigma_q",
                           "range of the layer's patches over its noise; 0: the authors' 0.35, of its mean",
                           0.9f,
                           {0, 0.9f, 1.8f, 3.6f},
                           0,
                           100}}},
      .filter = Filter};
}

}  // namespace lumifold::filter
