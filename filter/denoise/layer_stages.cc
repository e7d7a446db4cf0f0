#include "filter/denoise/layer_stages.h"

#include <algorithm>
#include <utility>

#include "absl/types/span.h"
#include "filter/denoise/firefly.h"
#include "filter/denoise/single_filtering.h"
#include "filter/edges/light_regression.h"
#include "filter/layers/features.h"
#include "filter/layers/guide.h"

namespace lumifold::filter {
namespace {

Planes Difference(const Planes& x, const Planes& y, TaskPool* pool) {
  Planes difference = MakeUninitializedPlanes(x.size(), x[0].width(), x[0].height());
  ForEachBand(pool, x[0].height(), [&](int, int y0, int y1) {
    for (size_t c = 0; c < x.size(); ++c) {
      for (int row = y0; row < y1; ++row) {
        const float* __restrict from = x[c].Row(row);
        const float* __restrict less = y[c].Row(row);
        float* __restrict out = difference[c].Row(row);
        for (int i = 0; i < x[c].width(); ++i) out[i] = from[i] - less[i];
      }
    }
  });
  return difference;
}

/// One half of a layer, for which index 0 stands for A and 1 for B.
struct Half {
  Planes planes;              // 3
  std::vector<float> points;  // 3 for each point of the fragments
};

const Planes& HalfOf(const Candidate& picture, size_t h) { return h == 0 ? picture.a : picture.b; }
const Planes& HalfOf(const Halves& halves, size_t h) { return h == 0 ? halves.a : halves.b; }
const Plane& WeightOf(const Halves& halves, size_t h) { return h == 0 ? halves.weight_a : halves.weight_b; }

/// The fragments as points of the manifolds.
SlicePoints PointsOf(const LayerFragments& fragments, float mixed_range) {
  SlicePoints points;
  points.pixels = fragments.places;
  points.own_features = fragments.own_features;
  points.features = fragments.features;
  points.pixel_divisor = mixed_range * mixed_range;
  return points;
}

/// What the filter leaves to points that it found nothing for: their own light, if any.
void KeepLostPoints(const SlicePoints& points, SlicedPoints* sliced) {
  for (size_t i = 0; i < points.weights.size(); ++i) {
    if (sliced->weights[i] > 0 || !(points.weights[i] > 0)) continue;
    const size_t channels = points.signals.size() / points.weights.size();
    std::copy_n(points.signals.begin() + static_cast<std::ptrdiff_t>(channels * i), channels,
                sliced->values.begin() + static_cast<std::ptrdiff_t>(channels * i));
  }
}

/// Sets the pixels that have fragments to the means over them.
void SetMixedPixels(const LayerFragments& fragments, size_t h, Half* half) {
  const auto always = [](size_t) { return true; };
  for (const LayerFragments::Pixel& pixel : fragments.pixels) {
    const auto mean = MeanOverPoints(fragments, pixel, h, half->points, always);
    for (size_t c = 0; mean.has_value() && c < 3; ++c) half->planes[c].At(pixel.x, pixel.y) = (*mean)[c];
  }
}

/// Layers of one surface, which differ in their light alone.
using Together = absl::Span<LayerState* const>;

/// Half `h` of the layers, less their first candidates where they have any: signals of one filtering.
struct Signals {
  Planes planes;  // 3 of each layer
  Plane mask;
  SlicePoints points;
};

Signals SignalsOf(Together layers, size_t h) {
  const LayerState& first = *layers[0];
  Signals signals{
      {}, WeightOf(first.halves, h).Clone(), PointsOf(first.fragments, first.settings.mixed_range)};
  signals.points.weights = first.fragments.share[h];
  signals.points.signals.resize(3 * layers.size() * first.fragments.places.size());
  for (size_t l = 0; l < layers.size(); ++l) {
    const LayerState& layer = *layers[l];
    const Candidate* base = layer.candidates.empty() ? nullptr : &layer.candidates.front();
    const Planes& light = HalfOf(layer.halves, h);
    for (Plane& plane : base != nullptr ? Difference(light, HalfOf(*base, h), layer.pool) : Clone(light))
      signals.planes.push_back(std::move(plane));
    const Plane& weight = WeightOf(layer.halves, h);  // a value may be unusable in one layer alone
    ForEachPixel(layer.pool, weight.width(), weight.height(), [&](int x, int y) {
      signals.mask.At(x, y) = std::min(signals.mask.At(x, y), weight.At(x, y));
    });
    const std::vector<float>& at_points = layer.fragments.light[h];
    for (size_t k = 0; k < at_points.size(); ++k)
      signals.points.signals[(k / 3 * layers.size() + l) * 3 + k % 3] =
          at_points[k] - (base != nullptr ? base->points[h][k] : 0.0f);
  }
  return signals;
}

/// Filters half `h` of the layers along the same manifolds; what their first candidates leave of it, if they
/// have any, and adds that to them: twicing.
std::vector<Half> FilterHalf(Together layers, size_t h, const Planes& features,
                             const ManifoldParams& manifolds) {
  const LayerState& first = *layers[0];
  const Signals signals = SignalsOf(layers, h);
  const bool has_points = !first.fragments.IsEmpty();
  ManifoldResult result =
      ManifoldFilterAtPoints(signals.planes, features, signals.mask.view(), manifolds,
                             first.settings.reach_px, has_points ? &signals.points : nullptr, first.pool);
  if (has_points) KeepLostPoints(signals.points, &result.points);
  std::vector<Half> halves(layers.size());
  for (size_t l = 0; l < layers.size(); ++l) {
    const LayerState& layer = *layers[l];
    Half& half = halves[l];
    for (size_t c = 0; c < 3; ++c) half.planes.push_back(std::move(result.filtered[3 * l + c]));
    half.points.resize(layer.fragments.light[h].size());
    for (size_t k = 0; k < half.points.size(); ++k)
      half.points[k] = result.points.values[(k / 3 * layers.size() + l) * 3 + k % 3];
    if (!layer.candidates.empty()) {
      const Candidate& base = layer.candidates.front();
      AddPlanes(HalfOf(base, h), layer.pool, absl::MakeSpan(half.planes));
      for (size_t k = 0; k < half.points.size(); ++k) half.points[k] += base.points[h][k];
    }
    SetMixedPixels(layer.fragments, h, &half);
  }
  return halves;
}

Candidate Pair(Half a, Half b) {
  return {std::move(a.planes), std::move(b.planes), {std::move(a.points), std::move(b.points)}};
}

/// Adds a candidate to each layer. Each half is guided by the other.
void FilterHalves(Together layers, FeaturePair features, const ManifoldParams& manifolds) {
  std::vector<Half> a = FilterHalf(layers, 0, features.b, manifolds);
  features.b.clear();  // first filterings need the most memory of all
  std::vector<Half> b = FilterHalf(layers, 1, features.a, manifolds);
  for (size_t l = 0; l < layers.size(); ++l)
    layers[l]->candidates.push_back(Pair(std::move(a[l]), std::move(b[l])));
}

/// The halves as they are, without what was removed as fireflies.
Candidate Noisy(const LayerState& state) {
  return {Clone(state.halves.a), Clone(state.halves.b), state.fragments.light};
}

void RunFireflies(LayerState* state) {
  std::vector<std::array<float, 2>> before;
  const Halves& halves = state->halves;
  for (const LayerFragments::Pixel& p : state->fragments.pixels)
    before.push_back({LuminanceAt(halves.a, p.x, p.y), LuminanceAt(halves.b, p.x, p.y)});
  state->removed = SuppressFireflies(state->settings.fireflies, state->settings.choice.wide_radius,
                                     &state->halves, state->pool);
  if (state->removed[0].empty()) return;
  for (size_t i = 0; i < before.size(); ++i) {
    const LayerFragments::Pixel& p = state->fragments.pixels[i];
    for (size_t h = 0; h < 2; ++h) {
      const float now = LuminanceAt(HalfOf(halves, h), p.x, p.y);
      if (!(now < before[i][h])) continue;
      for (size_t k = 3 * p.first; k < 3 * p.last; ++k) state->fragments.light[h][k] *= now / before[i][h];
    }
  }
}

/// The sum of the layers' light as a guide, in the unit of the layer that has most.
Guide GuideOf(Together layers) {
  const LayerState& first = *layers[0];
  float scale = 0;
  for (const LayerState* layer : layers) scale = std::max(scale, layer->halves.scale);
  std::array<Planes, 2> sum = {MakePlanes(3, first.halves.width(), first.halves.height()),
                               MakePlanes(3, first.halves.width(), first.halves.height())};
  float level = 0;
  for (const LayerState* layer : layers) {
    const float unit = layer->halves.scale / scale;
    level += unit * layer->halves.level;
    for (size_t h = 0; h < 2; ++h) {
      for (size_t c = 0; c < 3; ++c) {
        const Plane& light = HalfOf(layer->halves, h)[c];
        ForEachPixel(layer->pool, light.width(), light.height(),
                     [&](int x, int y) { sum[h][c].At(x, y) += unit * light.At(x, y); });
      }
    }
  }
  return MakeGuide(level, sum[0], sum[1], first.settings.knee, first.pool);
}

/// The light of all layers together tells more of shadows and edges than that of each, and one tree serves
/// all.
void RunFirstFiltering(Together layers) {
  const LayerState& first = *layers[0];
  const LayerSettings& settings = first.settings;
  for (LayerState* layer : layers)
    layer->guide_noise = NoiseOfHalf(layer->halves, GuideOf(Together(&layer, 1)), layer->pool);
  Guide guide = GuideOf(layers);
  const float noise = NoiseOfHalf(first.halves, guide, first.pool);
  FilterHalves(layers,
               MakeFeatures(std::move(guide), first.halves, settings.patches, settings.range_factor * noise,
                            first.geometry, first.pool),
               settings.first_manifolds);
}

void RunSecondFiltering(LayerState* state) {
  const LayerSettings& settings = state->settings;
  const Candidate& first = state->candidates.front();
  FilterHalves(Together(&state, 1),
               MakeFeatures(MakeGuide(state->halves.level, first.a, first.b, settings.knee, state->pool),
                            state->halves, settings.second_patches,
                            settings.second_range * state->guide_noise, state->geometry, state->pool),
               settings.second_manifolds);
}

void RunFireflyEnergy(LayerState* state) {
  const Candidate& first = state->candidates.front();
  state->firefly_energy =
      ReturnRemoved(state->removed, Combine(first.a, first.b, state->halves.share_a.view(), state->pool),
                    state->halves, state->geometry, state->settings.knee, state->settings.reach_px,
                    state->settings.fireflies, state->pool);
}

/// Moves the result towards a picture. Where a half has no sample of a fragment, the noisy layer says nothing
/// of it.
void Move(const Candidate& to, const Plane& share, bool is_noisy, LayerState* state) {
  MoveTowards(to.a, share, state->pool, &state->result.a);
  MoveTowards(to.b, share, state->pool, &state->result.b);
  const LayerFragments& fragments = state->fragments;
  for (size_t h = 0; h < 2; ++h) {
    for (size_t i = 0; i < fragments.places.size(); ++i) {
      if (is_noisy && !(fragments.share[h][i] > 0)) continue;
      const float t = share.At(fragments.places[i][0], fragments.places[i][1]);
      for (size_t k = 3 * i; k < 3 * i + 3; ++k)
        state->result.points[h][k] += t * (to.points[h][k] - state->result.points[h][k]);
    }
  }
}

/// Adds the energy that returns.
void AddEnergy(const LayerState& state, Candidate* to) {
  if (state.firefly_energy[0].empty()) return;
  for (size_t h = 0; h < 2; ++h) {
    const Planes& energy = state.firefly_energy[h];
    AddPlanes(energy, state.pool, absl::MakeSpan(h == 0 ? to->a : to->b));
    std::vector<float>& points = to->points[h];
    for (size_t k = 0; k < points.size(); ++k) {
      const auto [x, y] = state.fragments.places[k / 3];
      points[k] += energy[k % 3].At(x, y);
    }
  }
}

/// Makes the energy that was added to the halves the same in both: its mean. Samples where it returns do not
/// make it surer, so that it is no error of those places. What it was apart is kept.
void ShareEnergy(LayerState* state) {
  if (state->firefly_energy[0].empty()) return;
  state->returned = Difference(state->firefly_energy[0], state->firefly_energy[1], state->pool);
  const Planes mean =
      Combine(state->firefly_energy[0], state->firefly_energy[1], state->halves.share_a.view(), state->pool);
  for (Planes& energy : state->firefly_energy) energy = Difference(mean, energy, state->pool);
  AddEnergy(*state, &state->result);
}

/// The noisy layer at the fragments: `light`, in the halves' unit.
ChoicePoints PointsToCompare(const LayerState& state, std::array<std::vector<float>, 2> light) {
  const LayerFragments& fragments = state.fragments;
  ChoicePoints points{.places = fragments.places, .weights = {}, .samples = {}, .noisy = std::move(light)};
  for (size_t i = 0; i < fragments.places.size(); ++i) {
    const auto& [x, y] = fragments.places[i];
    const bool has_both = fragments.share[0][i] > 0 && fragments.share[1][i] > 0;
    const float covered = 0.5f * (fragments.coverage[0][i] + fragments.coverage[1][i]);
    const float share = 0.5f * (fragments.share[0][i] + fragments.share[1][i]);
    points.weights.push_back(has_both ? covered * covered : 0.0f);
    points.samples.push_back(std::max(1.0f, share * state.halves.samples.At(x, y)));
  }
  return points;
}

/// Moves the result towards each candidate.
void MoveTowardsAll(absl::Span<const Candidate> candidates, LayerState* state) {
  const ChoicePoints points = PointsToCompare(*state, state->fragments.light);
  const Choice choice(state->halves, LightOf(state->halves, state->result, state->pool),
                      state->settings.choice, &points, state->pool);
  for (const Candidate& candidate : candidates)
    Move(candidate, choice.ShareOf(state->result, candidate, state->pool), false, state);
}

void RunChoice(LayerState* state) {
  state->result = std::move(state->candidates.front());
  MoveTowardsAll(absl::MakeSpan(state->candidates).subspan(1), state);
}

/// Where the choice is switched off.
void UseLastCandidate(LayerState* state) {
  if (state->result.a.empty()) state->result = std::move(state->candidates.back());
}

void RunLightRegression(LayerState* state) {
  UseLastCandidate(state);
  const LayerSettings& settings = state->settings;
  const Candidate fitted = FitLight(state->halves, state->fragments, state->geometry, state->result,
                                    settings.regression, settings.knee, state->pool);
  MoveTowardsAll(absl::MakeConstSpan(&fitted, 1), state);
}

/// Moves the result towards the noisy layer without its fireflies. The share is that of the noisy layer as it
/// was: an outlier is taken out where the other half contradicts it, so without them the halves of rare light
/// agree by selection.
void RunNoisyChoice(LayerState* state) {
  UseLastCandidate(state);
  AddEnergy(*state, &state->result);
  Candidate noisy = Noisy(*state);
  AddEnergy(*state, &noisy);
  if (!state->removed[0].empty()) {
    AddPlanes(state->removed[0], state->pool, absl::MakeSpan(state->halves.a));
    AddPlanes(state->removed[1], state->pool, absl::MakeSpan(state->halves.b));
  }
  Candidate uncut = {Clone(state->halves.a), Clone(state->halves.b), state->fragments.noisy};
  for (std::vector<float>& half : uncut.points) {
    for (float& value : half) value /= state->halves.scale;
  }
  const ChoicePoints points = PointsToCompare(*state, uncut.points);
  const Choice choice(state->halves, LightOf(state->halves, state->result, state->pool),
                      state->settings.choice, &points, state->pool);
  Move(noisy, choice.ShareOf(state->result, uncut, state->pool), true, state);
  ShareEnergy(state);
}

/// Where the choice of the noisy layer is switched off.
void AddSharedEnergy(LayerState* state) {
  UseLastCandidate(state);
  AddEnergy(*state, &state->result);
  ShareEnergy(state);
}

void RunSingleFiltering(LayerState* state) {
  const Halves& halves = state->halves;
  const Planes mean = Combine(halves.a, halves.b, halves.share_a.view(), state->pool);
  const LayerFragments& fragments = state->fragments;
  SlicePoints points = PointsOf(fragments, state->settings.mixed_range);
  points.signals = fragments.light[0];
  points.weights.resize(fragments.places.size());
  for (size_t i = 0; i < points.weights.size(); ++i) {
    // The mean over both halves, of which most pixels have one.
    const auto [x, y] = fragments.places[i];
    const float a = halves.share_a.At(x, y) * fragments.share[0][i];
    const float b = (1.0f - halves.share_a.At(x, y)) * fragments.share[1][i];
    points.weights[i] = a + b;
    for (size_t k = 3 * i; a + b > 0 && k < 3 * i + 3; ++k)
      points.signals[k] = (a * fragments.light[0][k] + b * fragments.light[1][k]) / (a + b);
  }
  ManifoldResult filtered = FilterSingle(halves, mean, state->geometry, state->settings,
                                         fragments.IsEmpty() ? nullptr : &points, state->pool);
  if (!fragments.IsEmpty()) KeepLostPoints(points, &filtered.points);
  Half half{std::move(filtered.filtered), std::move(filtered.points.values)};
  SetMixedPixels(fragments, 0, &half);
  Half same{Clone(half.planes), half.points};
  state->result = Pair(std::move(half), std::move(same));
}

/// A stage that runs on each layer by itself.
template <void (*run)(LayerState*)>
void Each(Together layers) {
  for (LayerState* layer : layers) run(layer);
}

bool HasBothHalves(const LayerState& state) { return state.halves.has_noise_estimate; }
bool HasOneHalf(const LayerState& state) { return !state.halves.has_noise_estimate; }
bool HasCandidates(const LayerState& state) { return !state.candidates.empty(); }
bool HasMixedPixels(const LayerState& state) {
  return HasCandidates(state) && !state.halves.is_difference && state.halves.is_mixed.width() > 0;
}

constexpr char kChoiceSource[] = "Rousselle et al. 2012; Breiman 1996";
constexpr char kManifoldSource[] = "Gastal & Oliveira 2012; Gruzdev et al. 2015";

int ReachWindow(const Settings& settings) { return BlurWindow(settings.layer.reach_px); }

LayerState Open(const LayerSettings& settings, const Product& product, Halves halves,
                LayerFragments fragments, TaskPool* pool) {
  LayerState state{.settings = settings,
                   .geometry = product.geometry,
                   .pool = pool,
                   .halves = std::move(halves),
                   .fragments = std::move(fragments),
                   .guide_noise = 0,
                   .removed = {},
                   .candidates = {},
                   .firefly_energy = {},
                   .result = {},
                   .returned = {}};
  UseFragments(&state.fragments, &state.halves);
  return state;
}

/// To means over pixels, in the film's unit.
void RestoreUnits(const Product& product, float scale, TaskPool* pool, Candidate* light) {
  for (Planes* half : {&light->a, &light->b}) RestoreUnits(product, scale, pool, half);
  for (std::vector<float>& points : light->points) {
    for (float& value : points) value *= scale;
  }
}

LayerStage FirefliesStage() {
  return {{.name = "fireflies",
           .reads = "halves",
           .writes = "halves, removed energy",
           .off_when = "one half alone; the remainder",
           .source = "Cycles' prefilter of features",
           .header = "filter/denoise/firefly.h",
           .window_px = [](const Settings& s) { return s.layer.choice.wide_radius; }},
          [](const LayerState& s) { return HasBothHalves(s) && !s.halves.is_difference; },
          Each<RunFireflies>};
}

LayerStage SingleFilteringStage() {
  return {{.name = "single-filtering",
           .reads = "the layer's mean, fragments, geometry",
           .writes = "the filtered layer",
           .off_when = "both halves are known",
           .source = kManifoldSource,
           .header = "filter/denoise/single_filtering.h",
           .window_px = [](const Settings& s) { return BlurWindow(s.layer.single.manifolds.sigma_s); }},
          HasOneHalf,
          Each<RunSingleFiltering>};
}

LayerStage FirstFilteringStage() {
  return {{.name = "first-filtering",
           .reads = "halves, fragments, geometry",
           .writes = "candidate P, half by half",
           .off_when = "one half alone",
           .source = kManifoldSource,
           .header = "filter/manifold/manifold_filter.h",
           .window_px = ReachWindow},
          HasBothHalves,
          RunFirstFiltering};
}

LayerStage SecondFilteringStage() {
  return {{.name = "second-filtering",
           .reads = "halves, fragments, P, geometry",
           .writes = "candidate P + M(half - P), half by half",
           .off_when = "one half alone; the remainder",
           .source = "twicing: Tukey 1977",
           .header = "filter/manifold/manifold_filter.h",
           .window_px = ReachWindow},
          [](const LayerState& s) { return HasCandidates(s) && !s.halves.is_difference; },
          Each<RunSecondFiltering>};
}

LayerStage FireflyEnergyStage() {
  return {{.name = "firefly-energy",
           .reads = "removed energy, P, geometry",
           .writes = "energy to return",
           .off_when = "nothing was removed",
           .source = "our own",
           .header = "filter/denoise/firefly.h",
           .window_px = ReachWindow},
          [](const LayerState& s) { return HasCandidates(s) && !s.removed[0].empty(); },
          Each<RunFireflyEnergy>};
}

LayerStage ChoiceStage() {
  return {{.name = "choice",
           .reads = "halves, candidates",
           .writes = "the filtered layer, half by half",
           .off_when = "one half alone; when switched off, the last candidate is taken",
           .source = kChoiceSource,
           .header = "filter/layers/choice.h",
           .window_px = [](const Settings& s) { return ChoiceWindow(s.layer.choice); }},
          HasCandidates,
          Each<RunChoice>};
}

LayerStage LightRegressionStage() {
  return {{.name = "light-regression",
           .reads = "halves, fragments, the filtered layer, geometry",
           .writes = "the filtered layer at mixed pixels, half by half",
           .off_when = "one half alone; the remainder; no pixel of the layer is mixed",
           .source = "Bitterli et al. 2016",
           .header = "filter/edges/light_regression.h",
           .window_px = [](const Settings& s) { return RegressionWindow(s.layer.regression); }},
          HasMixedPixels,
          Each<RunLightRegression>};
}

LayerStage NoisyChoiceStage() {
  return {{.name = "noisy-choice",
           .reads = "halves as they were, the filtered layer, removed energy, energy to return",
           .writes = "the filtered layer, half by half",
           .off_when = "one half alone",
           .source = kChoiceSource,
           .header = "filter/layers/choice.h",
           .window_px = [](const Settings& s) { return ChoiceWindow(s.layer.choice); }},
          HasCandidates,
          Each<RunNoisyChoice>};
}

}  // namespace

const std::vector<LayerStage>& DefaultLayerStages() {
  static const std::vector<LayerStage> stages = {
      FirefliesStage(),     SingleFilteringStage(), FirstFilteringStage(),  SecondFilteringStage(),
      FireflyEnergyStage(), ChoiceStage(),          LightRegressionStage(), NoisyChoiceStage()};
  return stages;
}

std::vector<FilteredLayer> RunLayers(const std::vector<LayerStage>& stages, const LayerSettings& settings,
                                     absl::Span<const Product> products,
                                     std::vector<LayerFragments> fragments, const SwitchedOff& off,
                                     const StageWatch& watch, TaskPool* pool) {
  std::vector<FilteredLayer> filtered(products.size());
  std::vector<LayerState> states;
  std::vector<size_t> places;  // of the states among the products
  for (size_t i = 0; i < products.size(); ++i) {
    Halves halves = HalvesOf(products[i], pool);
    if (halves.level > 0) {
      states.push_back(Open(settings, products[i], std::move(halves), std::move(fragments[i]), pool));
      places.push_back(i);
      continue;
    }
    filtered[i] = BlackLayer(products[i]);
    filtered[i].light.points = fragments[i].light;
    filtered[i].fragments = std::move(fragments[i]);
  }
  for (const LayerStage& stage : stages) {
    std::vector<LayerState*> layers;
    for (LayerState& state : states) {
      if (!IsOff(off, stage.info.name) && stage.is_on(state)) layers.push_back(&state);
    }
    if (layers.empty()) continue;
    stage.run(layers);
    if (watch) watch(stage.info.name);
  }
  for (size_t i = 0; i < states.size(); ++i) {
    LayerState& state = states[i];
    if (HasCandidates(state) && IsOff(off, "noisy-choice")) AddSharedEnergy(&state);
    if (state.result.a.empty()) state.result = Noisy(state);  // its filtering is switched off
    RestoreUnits(products[places[i]], state.halves.scale, pool, &state.result);
    RestoreUnits(products[places[i]], state.halves.scale, pool, &state.returned);
    filtered[places[i]] = {std::move(state.result), std::move(state.fragments), std::move(state.returned)};
  }
  return filtered;
}

}  // namespace lumifold::filter
