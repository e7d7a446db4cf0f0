#include "filter/denoise/layer_stages.h"

#include <algorithm>
#include <utility>

#include "filter/denoise/firefly.h"
#include "filter/denoise/single_filtering.h"
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

/// The fragments as points of the manifolds, with `light` as signals.
SlicePoints PointsOf(const LayerFragments& fragments, float mixed_range, size_t h, std::vector<float> light) {
  SlicePoints points;
  points.pixels = fragments.places;
  points.own_features = fragments.own_features;
  points.features = fragments.features;
  points.pixel_divisor = mixed_range * mixed_range;
  points.signals = std::move(light);
  points.weights = fragments.share[h];
  return points;
}

/// What the filter leaves to points that it found nothing for: their own light, if any.
void KeepLostPoints(const SlicePoints& points, SlicedPoints* sliced) {
  for (size_t i = 0; i < points.weights.size(); ++i) {
    if (sliced->weights[i] > 0 || !(points.weights[i] > 0)) continue;
    std::copy_n(points.signals.begin() + static_cast<std::ptrdiff_t>(3 * i), 3,
                sliced->values.begin() + static_cast<std::ptrdiff_t>(3 * i));
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

/// Filters what `base`, if not null, leaves of half `h`, and adds it to the base: twicing.
Half FilterHalf(const LayerState& state, size_t h, const Planes& features, const ManifoldParams& manifolds,
                float reach_px, const Filtering* base) {
  const LayerFragments& fragments = state.fragments;
  const Planes& light = HalfOf(state.halves, h);
  const Planes rest = base != nullptr ? Difference(light, HalfOf(base->picture, h), state.pool) : Planes{};
  std::vector<float> rest_at_points = fragments.light[h];
  for (size_t i = 0; base != nullptr && i < rest_at_points.size(); ++i)
    rest_at_points[i] -= base->points[h][i];
  const SlicePoints points = PointsOf(fragments, state.settings.mixed_range, h, std::move(rest_at_points));
  ManifoldResult result =
      ManifoldFilterAtPoints(base != nullptr ? rest : light, features, WeightOf(state.halves, h).view(),
                             manifolds, reach_px, fragments.IsEmpty() ? nullptr : &points, state.pool);
  if (!fragments.IsEmpty()) KeepLostPoints(points, &result.points);
  Half half{std::move(result.filtered), std::move(result.points.values)};
  if (base != nullptr) {
    AddPlanes(HalfOf(base->picture, h), state.pool, absl::MakeSpan(half.planes));
    for (size_t i = 0; i < half.points.size(); ++i) half.points[i] += base->points[h][i];
  }
  SetMixedPixels(fragments, h, &half);
  return half;
}

Filtering Pair(Half a, Half b) {
  return {{std::move(a.planes), std::move(b.planes)}, {std::move(a.points), std::move(b.points)}};
}

Filtering Clone(const Filtering& from) {
  return {{lumifold::Clone(from.picture.a), lumifold::Clone(from.picture.b)}, from.points};
}

/// The halves as they are, without what was removed as fireflies.
Filtering Noisy(const LayerState& state) {
  return {{lumifold::Clone(state.halves.a), lumifold::Clone(state.halves.b)}, state.fragments.light};
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

void RunFirstFiltering(LayerState* state) {
  const LayerSettings& settings = state->settings;
  Guide guide = MakeGuide(state->halves, state->halves.a, state->halves.b, settings.knee, state->pool);
  state->guide_noise = NoiseOfHalf(state->halves, guide, state->pool);
  const FeaturePair features =
      MakeFeatures(std::move(guide), state->halves, settings.patches,
                   settings.range_factor * state->guide_noise, state->geometry, state->pool);
  Half a = FilterHalf(*state, 0, features.b, settings.first_manifolds, settings.reach_px, nullptr);
  Half b = FilterHalf(*state, 1, features.a, settings.first_manifolds, settings.reach_px, nullptr);
  state->candidates.push_back(Pair(std::move(a), std::move(b)));
}

/// Multiplies the coordinates of patches, which come before the geometry.
void ScalePatches(float by, size_t geometry, TaskPool* pool, Planes* features) {
  for (size_t k = 0; k + geometry < features->size(); ++k) {
    Plane& plane = (*features)[k];
    ForEachPixel(pool, plane.width(), plane.height(), [&](int x, int y) { plane.At(x, y) *= by; });
  }
}

void RunSecondFilterings(LayerState* state) {
  const LayerSettings& settings = state->settings;
  const Candidate& first = state->candidates.front().picture;
  float range = settings.twicing_ranges.front();
  FeaturePair features =
      MakeFeatures(MakeGuide(state->halves, first.a, first.b, settings.knee, state->pool), state->halves,
                   settings.second_patches, range * state->guide_noise, state->geometry, state->pool);
  for (const float next : settings.twicing_ranges) {
    if (next != range) {
      for (Planes* half : {&features.a, &features.b})
        ScalePatches(range / next, state->geometry.size(), state->pool, half);
      range = next;
    }
    const Filtering& base = state->candidates.front();
    Half a = FilterHalf(*state, 0, features.b, settings.twicing_manifolds, settings.reach_px, &base);
    Half b = FilterHalf(*state, 1, features.a, settings.twicing_manifolds, settings.reach_px, &base);
    state->candidates.push_back(Pair(std::move(a), std::move(b)));
  }
}

void RunFireflyEnergy(LayerState* state) {
  const Candidate& first = state->candidates.front().picture;
  state->firefly_energy =
      ReturnRemoved(state->removed, Combine(first.a, first.b, state->halves.share_a.view(), state->pool),
                    state->halves, state->geometry, state->settings.knee, state->settings.reach_px,
                    state->settings.fireflies, state->pool);
}

/// Moves the result towards a picture. Where a half has no sample of a fragment, the noisy layer says nothing of it.
void Move(const Filtering& to, const Plane& share, bool is_noisy, LayerState* state) {
  MoveTowards(to.picture.a, share, state->pool, &state->result.picture.a);
  MoveTowards(to.picture.b, share, state->pool, &state->result.picture.b);
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
void AddEnergy(const LayerState& state, Filtering* to) {
  if (state.firefly_energy[0].empty()) return;
  for (size_t h = 0; h < 2; ++h) {
    const Planes& energy = state.firefly_energy[h];
    AddPlanes(energy, state.pool, absl::MakeSpan(h == 0 ? to->picture.a : to->picture.b));
    std::vector<float>& points = to->points[h];
    for (size_t k = 0; k < points.size(); ++k) {
      const auto [x, y] = state.fragments.places[k / 3];
      points[k] += energy[k % 3].At(x, y);
    }
  }
}

/// Makes the energy that was added to the halves the same in both: its mean. Samples where it returns do not make it surer, so
/// that it is no error of those places. What it was apart is kept.
void ShareEnergy(LayerState* state) {
  if (state->firefly_energy[0].empty()) return;
  state->returned = Difference(state->firefly_energy[0], state->firefly_energy[1], state->pool);
  const Planes mean =
      Combine(state->firefly_energy[0], state->firefly_energy[1], state->halves.share_a.view(), state->pool);
  for (Planes& energy : state->firefly_energy) energy = Difference(mean, energy, state->pool);
  AddEnergy(*state, &state->result);
}

/// Moves the result towards the candidates.
void ChooseCandidates(LayerState* state) {
  const Choice choice(state->halves, LightOf(state->halves, state->result.picture, state->pool),
                      state->settings.choice, state->pool);
  for (size_t k = 1; k < state->candidates.size(); ++k) {
    const Filtering& candidate = state->candidates[k];
    Move(candidate, choice.ShareOf(state->result.picture, candidate.picture, state->pool), false, state);
  }
}

/// Moves the result towards the noisy layer without its fireflies. Both are compared with the halves as they were: an
/// outlier is taken out where the other half contradicts it, so without them the halves of rare light agree by selection.
void ChooseNoisy(LayerState* state) {
  Filtering noisy = Noisy(*state);
  AddEnergy(*state, &noisy);
  if (!state->removed[0].empty()) {
    AddPlanes(state->removed[0], state->pool, absl::MakeSpan(state->halves.a));
    AddPlanes(state->removed[1], state->pool, absl::MakeSpan(state->halves.b));
  }
  const Choice choice(state->halves, LightOf(state->halves, state->result.picture, state->pool),
                      state->settings.choice, state->pool);
  Move(noisy, choice.ShareOf(state->result.picture, noisy.picture, state->pool), true, state);
}

void RunChoice(LayerState* state) {
  state->result = Clone(state->candidates.front());
  ChooseCandidates(state);
  AddEnergy(*state, &state->result);
  ChooseNoisy(state);
  ShareEnergy(state);
}

void RunWithoutChoice(LayerState* state) {
  state->result = std::move(state->candidates.back());
  AddEnergy(*state, &state->result);
  ShareEnergy(state);
}

void RunSingleFiltering(LayerState* state) {
  const Halves& halves = state->halves;
  const Planes mean = Combine(halves.a, halves.b, halves.share_a.view(), state->pool);
  const LayerFragments& fragments = state->fragments;
  SlicePoints points = PointsOf(fragments, state->settings.mixed_range, 0, fragments.light[0]);
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
  Half same{lumifold::Clone(half.planes), half.points};
  state->result = Pair(std::move(half), std::move(same));
}

bool HasBothHalves(const LayerState& state) { return state.halves.has_noise_estimate; }
bool HasOneHalf(const LayerState& state) { return !state.halves.has_noise_estimate; }
bool HasCandidates(const LayerState& state) { return !state.candidates.empty(); }

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
void RestoreUnits(const Product& product, float scale, TaskPool* pool, Filtering* light) {
  for (Planes* half : {&light->picture.a, &light->picture.b}) RestoreUnits(product, scale, pool, half);
  for (std::vector<float>& points : light->points) {
    for (float& value : points) value *= scale;
  }
}

}  // namespace

const std::vector<LayerStage>& DefaultLayerStages() {
  static const std::vector<LayerStage> stages = {
      {{.name = "fireflies",
        .reads = "halves",
        .writes = "halves, removed energy",
        .off_when = "one half alone; the remainder",
        .source = "Cycles' prefilter of features",
        .header = "filter/denoise/firefly.h",
        .window_px = [](const Settings& s) { return s.layer.choice.wide_radius; }},
       [](const LayerState& s) { return HasBothHalves(s) && !s.halves.is_difference; },
       RunFireflies},
      {{.name = "single-filtering",
        .reads = "the layer's mean, fragments, geometry",
        .writes = "the filtered layer",
        .off_when = "both halves are known",
        .source = kManifoldSource,
        .header = "filter/denoise/single_filtering.h",
        .window_px = [](const Settings& s) { return BlurWindow(s.layer.single.manifolds.sigma_s); }},
       HasOneHalf,
       RunSingleFiltering},
      {{.name = "first-filtering",
        .reads = "halves, fragments, geometry",
        .writes = "candidate P, half by half",
        .off_when = "one half alone",
        .source = kManifoldSource,
        .header = "filter/manifold/manifold_filter.h",
        .window_px = ReachWindow},
       HasBothHalves,
       RunFirstFiltering},
      {{.name = "second-filtering",
        .reads = "halves, fragments, P, geometry",
        .writes = "candidates P + M(half - P) of two ranges, half by half",
        .off_when = "one half alone; the remainder",
        .source = "twicing: Tukey 1977",
        .header = "filter/manifold/manifold_filter.h",
        .window_px = ReachWindow},
       [](const LayerState& s) { return HasCandidates(s) && !s.halves.is_difference; },
       RunSecondFilterings},
      {{.name = "firefly-energy",
        .reads = "removed energy, P, geometry",
        .writes = "energy to return",
        .off_when = "nothing was removed",
        .source = "our own",
        .header = "filter/denoise/firefly.h",
        .window_px = ReachWindow},
       [](const LayerState& s) { return HasCandidates(s) && !s.removed[0].empty(); },
       RunFireflyEnergy},
      {{.name = "choice",
        .reads = "halves, candidates, removed energy, energy to return",
        .writes = "the filtered layer, half by half",
        .off_when = "one half alone; when switched off, the last candidate is taken",
        .source = "Rousselle et al. 2012; Breiman 1996",
        .header = "filter/layers/choice.h",
        .window_px = [](const Settings& s) { return ChoiceWindow(s.layer.choice); }},
       HasCandidates,
       RunChoice}};
  return stages;
}

FilteredLayer RunLayer(const std::vector<LayerStage>& stages, const LayerSettings& settings,
                       const Product& product, LayerFragments fragments, const SwitchedOff& off,
                       const StageWatch& watch, TaskPool* pool) {
  Halves halves = HalvesOf(product, pool);
  if (halves.level == 0) {
    FilteredLayer black = BlackLayer(product);
    black.light.points = fragments.light;
    black.fragments = std::move(fragments);
    return black;
  }
  const float scale = halves.scale;
  LayerState state = Open(settings, product, std::move(halves), std::move(fragments), pool);
  for (const LayerStage& stage : stages) {
    if (IsOff(off, stage.info.name) || !stage.is_on(state)) continue;
    stage.run(&state);
    if (watch) watch(stage.info.name);
  }
  if (state.result.picture.a.empty() && HasCandidates(state)) RunWithoutChoice(&state);
  if (state.result.picture.a.empty()) state.result = Noisy(state);  // its filtering is switched off
  RestoreUnits(product, scale, pool, &state.result);
  RestoreUnits(product, scale, pool, &state.returned);
  return {std::move(state.result), std::move(state.fragments), std::move(state.returned)};
}

}  // namespace lumifold::filter
