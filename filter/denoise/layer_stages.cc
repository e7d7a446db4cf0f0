#include "filter/denoise/layer_stages.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "absl/types/span.h"
#include "filter/denoise/firefly.h"
#include "filter/denoise/layer_device.h"
#include "filter/denoise/layer_points.h"
#include "filter/denoise/single_filtering.h"
#include "filter/edges/light_regression.h"
#include "filter/layers/features.h"
#include "filter/layers/guide.h"

namespace lumifold::filter {
namespace {

/// One half of a layer, for which index 0 stands for A and 1 for B.
struct Half {
  Planes planes;              // 3
  std::vector<float> points;  // 3 for each point of the fragments
};

const Planes& HalfOf(const Candidate& picture, size_t h) { return h == 0 ? picture.a : picture.b; }
const Plane& WeightOf(const Halves& halves, size_t h) { return h == 0 ? halves.weight_a : halves.weight_b; }

bool HasBothHalves(const LayerState& state) { return state.halves.has_noise_estimate; }
bool HasOneHalf(const LayerState& state) { return !state.halves.has_noise_estimate; }
/// Also where the device has chosen between them.
bool HasCandidates(const LayerState& state) { return !state.candidates.empty() || state.is_done; }
bool HasMixedPixels(const LayerState& state) {
  return HasCandidates(state) && !state.halves.is_difference && state.halves.is_mixed.width() > 0;
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

/// The points of half h that are filtered: all of their light, or what a base leaves of it.
SlicePoints InputOf(const LayerState& state, size_t h, const Candidate* base) {
  std::vector<float> light = state.fragments.light[h];
  for (size_t i = 0; base != nullptr && i < light.size(); ++i) light[i] -= base->points[h][i];
  return PointsOf(state.fragments, state.settings.mixed_range, h, std::move(light));
}

GuidedFiltering FilteringOf(const LayerState& state, size_t h, const SlicePoints& points,
                            const Candidate* base, const JointGuides& guides, float scale) {
  return {HalfOf(state.halves, h),          base != nullptr ? &HalfOf(*base, h) : nullptr,
          h == 0 ? guides.b : guides.a,     scale,
          WeightOf(state.halves, h).view(), state.fragments.IsEmpty() ? nullptr : &points};
}

/// The half of a candidate. Adds the base: twicing.
Half HalfFrom(const LayerState& state, size_t h, const SlicePoints& points, const Candidate* base,
              ManifoldResult result) {
  const LayerFragments& fragments = state.fragments;
  if (!fragments.IsEmpty()) KeepLostPoints(points, &result.points);
  Half half{std::move(result.filtered), std::move(result.points.values)};
  if (base != nullptr) {
    AddPlanes(HalfOf(*base, h), state.pool, absl::MakeSpan(half.planes));
    for (size_t i = 0; i < half.points.size(); ++i) half.points[i] += base->points[h][i];
  }
  SetMixedPixels(fragments, h, &half);
  return half;
}

Candidate Pair(Half a, Half b) {
  return {std::move(a.planes), std::move(b.planes), {std::move(a.points), std::move(b.points)}};
}

/// The halves as they are, without what was removed as fireflies.
Candidate Noisy(const LayerState& state) {
  return {Clone(state.halves.a), Clone(state.halves.b), state.fragments.light};
}

void RunFireflies(LayerState* state) {
  std::vector<std::array<float, 2>> before;
  before.reserve(state->fragments.pixels.size());
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
  state->missing = TakeMissing(state->product, state->fragments, halves, state->pool, &state->removed);
}

/// Of half A with coordinates of patches of each scale, then of half B; each is guided by the other.
std::vector<GuidedFiltering> FilteringsOf(const LayerState& state, const std::array<SlicePoints, 2>& inputs,
                                          const JointGuides& guides, const std::vector<float>& scales,
                                          const Candidate* base) {
  std::vector<GuidedFiltering> filterings;
  filterings.reserve(2 * scales.size());
  for (size_t h = 0; h < 2; ++h) {
    for (const float scale : scales)
      filterings.push_back(FilteringOf(state, h, inputs[h], base, guides, scale));
  }
  return filterings;
}

/// Filters both halves: a candidate for each scale. With a base: what it leaves.
std::vector<Candidate> FilterHalves(const LayerState& state, const JointGuides& guides,
                                    const std::vector<float>& scales, const ManifoldParams& manifolds,
                                    const Candidate* base) {
  const std::array<SlicePoints, 2> inputs = {InputOf(state, 0, base), InputOf(state, 1, base)};
  std::vector<ManifoldResult> results = FilterGuided(FilteringsOf(state, inputs, guides, scales, base),
                                                     manifolds, state.settings.reach_px, state.pool);
  std::vector<Candidate> candidates;
  candidates.reserve(scales.size());
  for (size_t i = 0; i < scales.size(); ++i)
    candidates.push_back(Pair(HalfFrom(state, 0, inputs[0], base, std::move(results[i])),
                              HalfFrom(state, 1, inputs[1], base, std::move(results[scales.size() + i]))));
  return candidates;
}

void RunFirstFiltering(LayerState* state) {
  const LayerSettings& settings = state->settings;
  Guide guide = MakeGuide(state->halves, state->halves.a, state->halves.b, settings.knee, state->pool);
  state->guide_noise = NoiseOfHalf(state->halves, guide, state->pool);
  if (FilterOnDevice(state)) return;
  const JointGuides guides =
      MakeJointGuides(std::move(guide), state->halves, settings.patches,
                      settings.range_factor * state->guide_noise, state->geometry, state->pool);
  state->candidates = FilterHalves(*state, guides, {1}, settings.first_manifolds, nullptr);
}

void RunSecondFilterings(LayerState* state) {
  const LayerSettings& settings = state->settings;
  const Candidate& first = state->candidates.front();
  const float widest = settings.twicing_ranges.front();
  const JointGuides guides =
      MakeJointGuides(MakeGuide(state->halves, first.a, first.b, settings.knee, state->pool), state->halves,
                      settings.second_patches, widest * state->guide_noise, state->geometry, state->pool);
  std::vector<float> scales;
  scales.reserve(settings.twicing_ranges.size());
  for (const float range : settings.twicing_ranges) scales.push_back(widest / range);
  for (Candidate& candidate : FilterHalves(*state, guides, scales, settings.twicing_manifolds, &first))
    state->candidates.push_back(std::move(candidate));
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

/// Moves the result towards the noisy layer without its fireflies. By how much is said by the noisy layer as
/// it was: an outlier is taken out where the other half contradicts it, so without them the halves of rare
/// light agree by selection.
void RunNoisyChoice(LayerState* state) {
  UseLastCandidate(state);
  AddEnergy(*state, &state->result);
  Candidate noisy = Noisy(*state);
  AddEnergy(*state, &noisy);
  if (!state->removed[0].empty()) {
    AddPlanes(state->removed[0], state->pool, absl::MakeSpan(state->halves.a));
    AddPlanes(state->removed[1], state->pool, absl::MakeSpan(state->halves.b));
  }
  const Candidate uncut{Clone(state->halves.a), Clone(state->halves.b), UncutLight(*state)};
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
  Half same{Clone(half.planes), half.points};
  state->result = Pair(std::move(half), std::move(same));
}

constexpr char kChoiceSource[] = "Rousselle et al. 2012; Breiman 1996";
constexpr char kManifoldSource[] = "Gastal & Oliveira 2012; Gruzdev et al. 2015";

int ReachWindow(const Settings& settings) { return BlurWindow(settings.layer.reach_px); }

LayerState Open(const LayerSettings& settings, const SwitchedOff& off, const Product& product, Halves halves,
                LayerFragments fragments, TaskPool* pool) {
  LayerState state{.settings = settings,
                   .off = off,
                   .product = product,
                   .geometry = product.geometry,
                   .pool = pool,
                   .halves = std::move(halves),
                   .fragments = std::move(fragments),
                   .guide_noise = 0,
                   .removed = {},
                   .missing = {},
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
           .reads = "halves, remainder",
           .writes = "halves, removed energy, what C lacks of it",
           .off_when = "one half alone; the remainder",
           .source = "Cycles' prefilter of features",
           .header = "filter/denoise/firefly.h",
           .window_px = [](const Settings& s) { return s.layer.choice.wide_radius; }},
          [](const LayerState& s) { return HasBothHalves(s) && !s.halves.is_difference; },
          RunFireflies};
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
          RunSingleFiltering};
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
           .writes = "candidates P + M(half - P) of two ranges, half by half",
           .off_when = "one half alone; the remainder",
           .source = "twicing: Tukey 1977",
           .header = "filter/manifold/manifold_filter.h",
           .window_px = ReachWindow},
          [](const LayerState& s) { return HasCandidates(s) && !s.halves.is_difference; },
          RunSecondFilterings};
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
          RunFireflyEnergy};
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
          RunChoice};
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
          RunLightRegression};
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
          RunNoisyChoice};
}

}  // namespace

const std::vector<LayerStage>& DefaultLayerStages() {
  static const std::vector<LayerStage> stages = {
      FirefliesStage(),     SingleFilteringStage(), FirstFilteringStage(),  SecondFilteringStage(),
      FireflyEnergyStage(), ChoiceStage(),          LightRegressionStage(), NoisyChoiceStage()};
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
  LayerState state = Open(settings, off, product, std::move(halves), std::move(fragments), pool);
  for (const LayerStage& stage : stages) {
    if (IsOff(off, stage.info.name) || !stage.is_on(state)) continue;
    if (!state.is_done) stage.run(&state);
    if (watch) watch(stage.info.name);
  }
  if (!state.candidates.empty() && IsOff(off, "noisy-choice")) AddSharedEnergy(&state);
  if (state.result.a.empty()) state.result = Noisy(state);  // its filtering is switched off
  RestoreUnits(product, scale, pool, &state.result);
  RestoreUnits(product, scale, pool, &state.returned);
  return {std::move(state.result), std::move(state.fragments), std::move(state.returned),
          std::move(state.missing)};
}

}  // namespace lumifold::filter
