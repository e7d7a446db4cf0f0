#include "filter/denoise/frame_stages.h"

#include <utility>

#include "filter/denoise/convergence.h"
#include "filter/edges/coverage_means.h"
#include "filter/edges/regression.h"
#include "filter/edges/relighting.h"
#include "filter/edges/trust.h"
#include "filter/layers/recombine.h"

namespace lumifold::filter {
namespace {

/// Albedo of the glossy lobes above which sub-samples, which have T and E alone, do not antialias a pixel.
constexpr float kMaxGlossyAlbedo = 0.12f;

bool HasEdges(const FrameState& state) { return state.frame.edges.has_value(); }
bool HasEdgePoints(const FrameState& state) { return !state.edge_points.rows.empty(); }
bool Always(const FrameState&) { return true; }

FilteredLayer FilterProduct(const FrameState& state, const Product& product, const SlicePoints* points) {
  return RunLayer(state.layer_stages, state.settings.layer, product, points, state.off, state.watch,
                  state.pool);
}

/// Where the product's values are also wanted between pixels; null: nowhere.
FilteredPoints* PointsOf(Product::Kind kind, FrameState* state) {
  if (!HasEdgePoints(*state)) return nullptr;
  if (kind == Product::Kind::kDirect) return &state->direct_at_points;
  return kind == Product::Kind::kIndirect ? &state->indirect_at_points : nullptr;
}

void RunLayers(FrameState* state) {
  const Frame& frame = state->frame;
  const Settings& settings = state->settings;
  std::vector<Product> products = ProductsOf(frame, settings.products, state->pool);
  if (!IsOff(state->off, "antialiasing")) {
    state->edge_points = EdgePointsOf(frame, kMaxGlossyAlbedo, settings.max_antialiased_samples,
                                      settings.products.sigma_normal);
  }
  state->remainder = MakeRemainder(frame, products, state->pool);
  if (state->watch) state->watch("layers");  // the stages of each layer tell of themselves
  for (Product& product : products) {
    FilteredPoints* at_points = PointsOf(product.kind, state);
    FilteredLayer layer;
    if (at_points != nullptr) {
      const SlicePoints points = RelativeTo(product.box, state->edge_points.points);
      layer = FilterProduct(*state, product, &points);
      *at_points = std::move(layer.points);
    } else {
      layer = FilterProduct(*state, product, nullptr);
    }
    state->products.push_back({std::move(product), std::move(layer.planes)});
  }
}

void RunRecombination(FrameState* state) {
  state->picture = Recombine(state->frame, state->products, state->pool);
}

void RunRemainder(FrameState* state) {
  if (IsRounding(state->remainder, state->frame, state->pool)) return;
  const Rect& box = state->products.front().product.box;  // of D and I: around all hits
  const Product rest = RemainderProduct(state->frame, state->remainder, box, state->picture,
                                        state->settings.products, state->pool);
  const FilteredLayer filtered = FilterProduct(*state, rest, nullptr);
  AddChange(rest.mean, filtered.planes, box, state->pool, &state->picture);
}

/// Sum of light, or of light * factor, over the filtered products of the kinds that `takes`. W x H.
template <typename Takes>
Planes SumOfProducts(const FrameState& state, bool times_factor, const Takes& takes) {
  Planes sum = MakePlanes(3, state.frame.width, state.frame.height);
  for (const auto& [product, planes] : state.products) {
    if (!takes(product.kind)) continue;
    const Rect& box = product.box;
    for (size_t c = 0; c < 3; ++c) {
      const ConstFloatView factor = product.factor[c];
      const Plane& light = planes[c];
      ForEachPixel(state.pool, box.width(), box.height(), [&](int x, int y) {
        const float by = times_factor ? factor.At(box.x0 + x, box.y0 + y) : 1.0f;
        sum[c].At(box.x0 + x, box.y0 + y) += light.At(x, y) * by;
      });
    }
  }
  return sum;
}

void RunCoverage(FrameState* state) {
  const Planes light = SumOfProducts(*state, false, [](Product::Kind kind) {
    return kind == Product::Kind::kDirect || kind == Product::Kind::kIndirect;
  });
  state->coverage_change = CoverageChange(state->frame, light, state->pool);
  AddPlanes(state->coverage_change, state->pool, absl::MakeSpan(state->picture));
}

void RunAntialiasing(FrameState* state) {
  const Planes glossy =
      SumOfProducts(*state, true, [](Product::Kind kind) { return kind == Product::Kind::kLobe; });
  AntialiasEdges(state->frame, state->edge_points, state->direct_at_points, state->indirect_at_points, glossy,
                 state->pool, &state->picture);
}

void RunRelighting(FrameState* state) {
  RelightEdges(state->frame, kMaxGlossyAlbedo, state->pool, &state->picture);
}

void RunRegression(FrameState* state) {
  if (state->coverage_change.empty())
    state->coverage_change = MakePlanes(3, state->frame.width, state->frame.height);
  RegressEdges(state->frame, state->coverage_change, state->pool, &state->picture);
}

void RunConvergence(FrameState* state) { ShrinkResidual(state->frame, state->pool, &state->picture); }

const FrameStage kLayers = {
    {.name = "layers",
     .reads = "film",
     .writes = "D, I, lobes and levels, each through the stages of a layer; remainder",
     .off_when = "never",
     .source = "Gruzdev et al. 2015",
     .header = "filter/layers/product.h",
     .is_required = true},
    Always,
    RunLayers};

const FrameStage kRecombination = {{.name = "recombination",
                                    .reads = "C, filtered layers",
                                    .writes = "picture",
                                    .off_when = "never",
                                    .source = "Gruzdev et al. 2015",
                                    .header = "filter/layers/recombine.h",
                                    .is_required = true},
                                   Always,
                                   RunRecombination};

const FrameStage kRemainder = {{.name = "remainder",
                                .reads = "remainder, picture",
                                .writes = "picture",
                                .off_when = "the remainder is rounding alone",
                                .source = "our own",
                                .header = "filter/layers/remainder.h"},
                               Always,
                               RunRemainder};

const FrameStage kAntialiasing = {
    {.name = "antialiasing",
     .reads = "D and I at sub-samples, T and E of sub-samples, lobes, C",
     .writes = "picture, at edge pixels",
     .off_when = "no edge set; pixels of many samples, with gloss, metal, mirror or glass",
     .source = "Gruzdev et al. 2015",
     .header = "filter/edges/antialiasing.h",
     .window_px = [](const Settings&) { return TrustParams{}.radius; }},
    HasEdgePoints,
    RunAntialiasing};

}  // namespace

const std::vector<FrameStage>& DefaultFrameStages() {
  static const std::vector<FrameStage> stages = {
      kLayers,
      kRecombination,
      kRemainder,
      {{.name = "coverage",
        .reads = "filtered D and I, T and E of samples and sub-samples",
        .writes = "picture, at edge pixels; coverage change",
        .off_when = "no edge set",
        .source = "our own; patch distance of Buades et al. 2005",
        .header = "filter/edges/coverage_means.h",
        .window_px = [](const Settings&) { return CoverageWindow(); }},
       HasEdges,
       RunCoverage},
      kAntialiasing,
      {{.name = "relighting",
        .reads = "picture, sub-samples, C",
        .writes = "picture, at pixels of several surfaces",
        .off_when = "no edge set or no object ids",
        .source = "our own",
        .header = "filter/edges/relighting.h",
        .window_px = [](const Settings&) { return RelightingWindow(); }},
       HasEdges,
       RunRelighting},
      {{.name = "regression",
        .reads = "picture, C by halves, coverage change, T, normal, mask, S, distance, roughness",
        .writes = "picture, at edge pixels and beside them, at metals, in mirrors and glass",
        .off_when = "one half alone",
        .source = "Bitterli et al. 2016",
        .header = "filter/edges/regression.h",
        .window_px = [](const Settings&) { return RegressionWindow(); }},
       Always,
       RunRegression},
      {{.name = "convergence",
        .reads = "picture, C by halves",
        .writes = "picture",
        .off_when = "one half alone",
        .source = "our own",
        .header = "filter/denoise/convergence.h",
        .window_px = [](const Settings&) { return ShrinkWindow(); }},
       Always,
       RunConvergence}};
  return stages;
}

const std::vector<FrameStage>& PublishedFrameStages() {
  static const std::vector<FrameStage> stages = {kLayers, kRecombination, kRemainder, kAntialiasing};
  return stages;
}

}  // namespace lumifold::filter
