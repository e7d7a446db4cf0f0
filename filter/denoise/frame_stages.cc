#include "filter/denoise/frame_stages.h"

#include <optional>
#include <utility>

#include "filter/edges/regression.h"
#include "filter/layers/layer_fragments.h"
#include "filter/layers/mixed_pixels.h"

namespace lumifold::filter {
namespace {

bool Always(const FrameState&) { return true; }

bool HasBothHalves(const FrameState& state) {
  const SampleCounts& samples = state.frame.samples;
  const double pairs = SumRows(state.pool, state.frame.height, [&](int y) {
    int count = 0;
    for (int x = 0; x < state.frame.width; ++x) count += samples.HasBoth(x, y) ? 1 : 0;
    return static_cast<double>(count);
  });
  return pairs > 0;
}

/// Tells the progress, too, of the stages of a layer, as if they took equally long; `done` layers are before.
StageWatch WatchOfLayer(const FrameState& state, double done) {
  if (!state.progress.told) return state.watch;
  const auto count = static_cast<double>(state.layer_stages.size());
  return [&state, done, count, ended = 0](std::string_view stage) mutable {
    if (state.watch) state.watch(stage);
    state.progress.Tell(done + ++ended / count);
  };
}

LayerFragments FragmentsOfProduct(const FrameState& state, const Product& product) {
  return LayerFragmentsOf(state.frame, state.fragments, product, state.settings.products.ranges);
}

FilteredLayer FilterProduct(const FrameState& state, const StageWatch& watch, Product* product) {
  product->is_mixed = MixedPart(state.mixed, product->box);
  LayerFragments fragments = FragmentsOfProduct(state, *product);
  UseDominantFeatures(fragments, &product->geometry);
  return RunLayer(state.layer_stages, state.settings.layer, *product, std::move(fragments), state.off, watch,
                  state.pool);
}

void RunFragments(FrameState* state) { state->fragments = FragmentsOf(state->frame); }

/// What the stages after the layers take, in layers: the remainder one, and the others together.
constexpr int kLayersOfRest = 2;

double LayersBeforeRest(const LayerProgress& progress) { return 1 / progress.layer_share - kLayersOfRest; }

void RunLayers(FrameState* state) {
  const Frame& frame = state->frame;
  std::vector<Product> products = ProductsOf(frame, state->settings.products, state->pool);
  state->hits = products.front().box;
  state->mixed = MixedPixelsOf(frame, state->settings.mixed_albedo);
  state->change = NoChange(frame);
  AddEmissionChange(state->fragments, &state->change);
  state->rest = WithoutEmission(frame, state->pool);
  SubtractEmissionOfHalves(state->fragments, &state->rest);
  for (const Product& product : products)
    SubtractNoisy(product, FragmentsOfProduct(*state, product), state->pool, &state->rest);
  if (state->watch) state->watch("layers");  // the stages of each layer tell of themselves
  state->progress.layer_share = 1 / (static_cast<double>(products.size()) + kLayersOfRest);
  double done = 0;
  for (Product& product : products) {
    product.rest_of = {ViewOf(state->rest.a), ViewOf(state->rest.b)};
    const FilteredLayer layer = FilterProduct(*state, WatchOfLayer(*state, done), &product);
    AddFiltered(product, layer, state->pool, &state->rest, &state->change);
    AddReturned(frame, product, layer, state->pool, &state->returned);
    state->progress.Tell(++done);
  }
}

bool HasLens(const FrameState& state) { return !state.frame.surface.blur.IsEmpty() && HasBothHalves(state); }

bool CanHaveNoisyFactors(const FrameState& state) {
  return HasLens(state) || (state.frame.surface.is_foreign && HasBothHalves(state));
}

/// The halves of the picture without the remainder: filtered light times T and S of each half, and its E.
BlurredPicture PictureOfLayers(const FrameState& state) {
  BlurredPicture picture = {Clone(state.change[0]), Clone(state.change[1]), {}};
  for (Planes* half : {&picture.a, &picture.b}) {
    const ConstColorView& combined = half == &picture.a ? state.frame.combined.a : state.frame.combined.b;
    const Planes& rest = half == &picture.a ? state.rest.a : state.rest.b;
    for (size_t c = 0; c < 3; ++c) {
      ForEachPixel(state.pool, state.frame.width, state.frame.height, [&](int x, int y) {
        (*half)[c].At(x, y) += UsableOr0(combined[c].At(x, y)) - rest[c].At(x, y);
      });
    }
  }
  picture.mean = MeanOfHalves(state.frame, picture.a, picture.b, state.pool);
  return picture;
}

void RunLens(FrameState* state) {
  const Frame& frame = state->frame;
  const BlurredPicture picture = PictureOfLayers(*state);
  std::optional<Product> product = BlurredProduct(frame, picture);
  if (!product.has_value()) return;
  const FilteredLayer layer = FilterProduct(*state, state->watch, &*product);
  AddFiltered(*product, layer, state->pool, nullptr, &state->change);
  AddReturned(frame, *product, layer, state->pool, &state->returned);
}

void FilterRemainder(FrameState* state) {
  const Frame& frame = state->frame;
  if (IsRounding(state->rest, frame, state->pool)) return;
  Product rest = RemainderProduct(frame, state->hits, PictureOf(frame, state->change, state->pool),
                                  state->settings.products, state->pool, &state->rest);
  const FilteredLayer layer =
      FilterProduct(*state, WatchOfLayer(*state, LayersBeforeRest(state->progress)), &rest);
  AddFiltered(rest, layer, state->pool, nullptr, &state->change);
  AddReturned(frame, rest, layer, state->pool, &state->returned);
}

void RunRemainder(FrameState* state) {
  FilterRemainder(state);
  state->progress.Tell(LayersBeforeRest(state->progress) + 1);
}

void RunRegression(FrameState* state) {
  state->candidates =
      FitMixedPixels(state->frame, state->mixed, state->change, state->settings.layer.regression,
                     state->settings.layer.knee, state->settings.products.ranges, state->pool);
}

/// Sets the blurred pixels of `change` to those of `before`.
void RestoreBlurred(const FrameState& state, const FrameChange& before, FrameChange* change) {
  ForEachPixel(state.pool, state.frame.width, state.frame.height, [&](int x, int y) {
    if (!IsBlurred(state.frame, x, y)) return;
    for (size_t h = 0; h < 2; ++h) {
      for (size_t c = 0; c < 3; ++c) (*change)[h][c].At(x, y) = before[h][c].At(x, y);
    }
  });
}

void RunFrameChoice(FrameState* state) {
  const bool restores = HasLens(*state) && !IsOff(state->off, "lens");
  FrameChange before;
  if (restores) before = {Clone(state->change[0]), Clone(state->change[1])};
  const Plane of_noisy = ChooseChange(state->frame, state->mixed, state->candidates, state->settings.layer,
                                      state->pool, &state->change);
  for (Plane& plane : state->returned) {  // nothing returns to C
    ForEachPixel(state->pool, plane.width(), plane.height(), [&](int x, int y) {
      if (!(restores && IsBlurred(state->frame, x, y))) plane.At(x, y) *= 1.0f - of_noisy.At(x, y);
    });
  }
  if (restores) RestoreBlurred(*state, before, &state->change);
}

void RunRecombination(FrameState* state) {
  state->picture = PictureOf(state->frame, state->change, state->pool);
}

FrameStage LensStage() {
  return {{.name = "lens",
           .reads = "filtered layers with T, S and E of each half; blur",
           .writes = "picture where a lens blurs it, or where T is another renderer's, half by half",
           .off_when = "a film of our own with a pinhole camera; one half alone",
           .source = "our own",
           .header = "filter/layers/product.h"},
          CanHaveNoisyFactors,
          RunLens};
}

}  // namespace

const std::vector<FrameStage>& DefaultFrameStages() {
  static const std::vector<FrameStage> stages = {
      {{.name = "fragments",
        .reads = "fragments and sub-samples of edge pixels",
        .writes = "surfaces of each mixed pixel: coverage, T, S, features; E of mixed pixels",
        .off_when = "the film has no edge set",
        .source = "our own; coverage: Gruzdev et al. 2015",
        .header = "filter/layers/fragments.h"},
       [](const FrameState& s) { return s.frame.edges.has_value(); },
       RunFragments},
      {{.name = "layers",
        .reads = "film",
        .writes = "D, I, lobes and levels, each through the stages of a layer; remainder",
        .off_when = "never",
        .source = "Gruzdev et al. 2015",
        .header = "filter/layers/product.h",
        .is_required = true},
       Always,
       RunLayers},
      LensStage(),
      {{.name = "remainder",
        .reads = "remainder, picture",
        .writes = "picture",
        .off_when = "the remainder is rounding alone",
        .source = "our own",
        .header = "filter/layers/remainder.h"},
       Always,
       RunRemainder},
      {{.name = "regression",
        .reads = "picture, C by halves, T, normal, mask, S, distance, roughness",
        .writes = "candidates at edge pixels and beside them, at metals, in mirrors and glass",
        .off_when = "one half alone",
        .source = "Bitterli et al. 2016",
        .header = "filter/edges/regression.h",
        .window_px = [](const Settings& s) { return RegressionWindow(s.layer.regression); }},
       HasBothHalves,
       RunRegression},
      {{.name = "frame-choice",
        .reads = "C by halves, candidates",
        .writes = "picture",
        .off_when = "one half alone",
        .source = "Rousselle et al. 2012; Breiman 1996",
        .header = "filter/layers/choice.h",
        .window_px = [](const Settings& s) { return ChoiceWindow(s.layer.choice); }},
       HasBothHalves,
       RunFrameChoice},
      {{.name = "recombination",
        .reads = "C, changes",
        .writes = "picture",
        .off_when = "never",
        .source = "Gruzdev et al. 2015",
        .header = "filter/layers/recombination.h",
        .is_required = true},
       Always,
       RunRecombination}};
  return stages;
}

}  // namespace lumifold::filter
