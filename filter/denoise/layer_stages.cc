#include "filter/denoise/layer_stages.h"

#include <algorithm>
#include <utility>

#include "filter/denoise/firefly.h"
#include "filter/layers/features.h"

namespace lumifold::filter {
namespace {

/// Noise below this part of the layer's mean counts as this much, so that a noise-free layer divides by no
/// zero.
constexpr float kMinNoise = 1e-4f;

/// Both halves of a picture as guides: with stabilised variance.
struct Guide {
  Planes a;
  Planes b;
};

Guide MakeGuide(const Halves& halves, const Planes& a, const Planes& b, float knee, TaskPool* pool) {
  return {Stabilise(a, knee * halves.level, halves.level, pool),
          Stabilise(b, knee * halves.level, halves.level, pool)};
}

/// RMS noise of one half of the guide.
float NoiseOfHalf(const Halves& halves, const Guide& guide, TaskPool* pool) {
  constexpr float kHalfOverMean = 1.41421356f;
  return std::max(kHalfOverMean * NoiseLevel(halves, guide.a, guide.b, pool), kMinNoise);
}

PatchBasis BasisOf(const Guide& guide, const Halves& halves, const PatchParams& params, TaskPool* pool) {
  const Planes mean = Combine(guide.a, guide.b, halves.share_a.view(), pool);
  return FitPatchBasis(mean, halves.weight.view(), params, pool);
}

/// The geometry features that are on.
Planes SelectGeometry(const Planes& geometry, const LayerSettings& settings) {
  constexpr size_t kDepth = kGeometryFeatures - 1;  // after the normal
  Planes selected;
  for (size_t i = 0; i < geometry.size(); ++i) {
    const bool is_on = i < kDepth ? settings.has_normals : (i > kDepth || settings.has_depth);
    if (is_on) selected.push_back(geometry[i].Clone());
  }
  return selected;
}

/// Feature vectors of both halves.
struct FeaturePair {
  Planes a;
  Planes b;
};

/// Consumes the guide: its planes are freed before the manifolds need memory.
FeaturePair MakeFeatures(Guide&& from, const PatchBasis& basis, float sigma_q, const Planes& geometry,
                         TaskPool* pool) {
  const Guide guide = std::move(from);
  return {JointFeatures(guide.a, basis, sigma_q, geometry, pool),
          JointFeatures(guide.b, basis, sigma_q, geometry, pool)};
}

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

/// added += base, at the points that the base found; `added` is 0 elsewhere.
void AddToPoints(const SlicedPoints& base, SlicedPoints* added) {
  for (size_t i = 0; i < base.values.size(); ++i) added->values[i] += base.values[i];
  added->weights = base.weights;
}

/// How one half is filtered.
struct Pass {
  const ManifoldParams& manifolds;
  float reach_px;
  const SlicePoints* points;  // may be null
  TaskPool* pool;
};

ManifoldResult FilterHalf(const Planes& half, ConstFloatView weight, const Planes& features,
                          const Pass& pass) {
  return ManifoldFilterAtPoints(half, features, weight, pass.manifolds, pass.reach_px, pass.points,
                                pass.pool);
}

/// `base` plus what the filter finds of the rest that the base leaves of the half: twicing.
ManifoldResult FilterRest(const Planes& half, ConstFloatView weight, const Planes& features,
                          const Planes& base, const SlicedPoints& base_points, const Pass& pass) {
  ManifoldResult result = FilterHalf(Difference(half, base, pass.pool), weight, features, pass);
  AddPlanes(base, pass.pool, absl::MakeSpan(result.filtered));
  AddToPoints(base_points, &result.points);
  return result;
}

Filtering Pair(ManifoldResult a, ManifoldResult b) {
  return {{std::move(a.filtered), std::move(b.filtered)}, std::move(a.points), std::move(b.points)};
}

void RunFireflies(LayerState* state) { state->removed = SuppressFireflies(&state->halves, state->pool); }

/// Features of a filtering; `guide` is consumed.
FeaturePair FeaturesOf(const LayerState& state, Guide guide, const PatchParams& patches, float sigma_q) {
  const PatchBasis basis = BasisOf(guide, state.halves, patches, state.pool);
  if (state.settings.has_normals && state.settings.has_depth)
    return MakeFeatures(std::move(guide), basis, sigma_q, state.geometry, state.pool);
  const Planes geometry = SelectGeometry(state.geometry, state.settings);
  return MakeFeatures(std::move(guide), basis, sigma_q, geometry, state.pool);
}

void RunFirstFiltering(LayerState* state) {
  const Halves& halves = state->halves;
  const LayerSettings& settings = state->settings;
  Guide guide = MakeGuide(halves, halves.a, halves.b, settings.knee, state->pool);
  state->guide_noise = NoiseOfHalf(halves, guide, state->pool);
  const FeaturePair features =
      FeaturesOf(*state, std::move(guide), settings.patches, settings.range_factor * state->guide_noise);
  const Pass pass = {settings.first_manifolds, settings.first_reach_px, state->points, state->pool};
  ManifoldResult a = FilterHalf(halves.a, halves.weight_a.view(), features.b, pass);
  ManifoldResult b = FilterHalf(halves.b, halves.weight_b.view(), features.a, pass);
  state->candidates.push_back(Pair(std::move(a), std::move(b)));
}

void RunSecondFiltering(LayerState* state) {
  const Halves& halves = state->halves;
  const LayerSettings& settings = state->settings;
  const Filtering& first = state->candidates.front();
  Guide guide = MakeGuide(halves, first.picture.a, first.picture.b, settings.knee, state->pool);
  const FeaturePair features = FeaturesOf(*state, std::move(guide), settings.second_patches,
                                          settings.second_range_factor * state->guide_noise);
  const Pass pass = {settings.second_manifolds, settings.second_reach_px, state->points, state->pool};
  ManifoldResult a =
      FilterRest(halves.a, halves.weight_a.view(), features.b, first.picture.a, first.points_a, pass);
  ManifoldResult b =
      FilterRest(halves.b, halves.weight_b.view(), features.a, first.picture.b, first.points_b, pass);
  state->candidates.push_back(Pair(std::move(a), std::move(b)));
}

void RunFireflyEnergy(LayerState* state) {
  const Candidate& first = state->candidates.front().picture;
  const Halves& halves = state->halves;
  const Planes light = Combine(first.a, first.b, halves.share_a.view(), state->pool);
  const Planes stable = Stabilise(light, state->settings.knee * halves.level, halves.level, state->pool);
  state->firefly_energy =
      SpreadRemoved(state->removed, stable, state->geometry, halves.weight.view(), state->pool);
}

void RunChoice(LayerState* state) {
  std::vector<const Candidate*> pictures;
  for (const Filtering& candidate : state->candidates) pictures.push_back(&candidate.picture);
  state->shares =
      SelectCandidates(state->halves, state->raw_variance, pictures, state->settings.selection, state->pool);
}

void AddProduct(const Plane& share, const Plane& value, int y, Plane* sum) {
  const float* __restrict s = share.Row(y);
  const float* __restrict v = value.Row(y);
  float* __restrict out = sum->Row(y);
  for (int x = 0; x < share.width(); ++x) out[x] += s[x] * v[x];
}

/// shares[0] * raw + sum of shares[i + 1] * (candidate i + firefly energy).
Planes BlendPlanes(const LayerState& state) {
  const Halves& halves = state.halves;
  std::vector<Planes> means;
  for (const Filtering& candidate : state.candidates)
    means.push_back(Combine(candidate.picture.a, candidate.picture.b, halves.share_a.view(), state.pool));
  Planes sums = MakePlanes(3, halves.width(), halves.height());
  ForEachBand(state.pool, halves.height(), [&](int, int y0, int y1) {
    for (int y = y0; y < y1; ++y) {
      for (size_t c = 0; c < 3; ++c) {
        AddProduct(state.shares[0], state.raw[c], y, &sums[c]);
        for (size_t i = 0; i < means.size(); ++i) {
          AddProduct(state.shares[i + 1], means[i][c], y, &sums[c]);
          if (!state.firefly_energy.empty())
            AddProduct(state.shares[i + 1], state.firefly_energy[c], y, &sums[c]);
        }
      }
    }
  });
  return sums;
}

/// Adds share times one candidate's values at the points of one pixel, both halves together.
void AddPoints(const Filtering& candidate, size_t pixel, size_t samples, float share, float share_a,
               FilteredPoints* sums) {
  for (size_t j = pixel * samples; j < (pixel + 1) * samples; ++j) {
    const float a = candidate.points_a.weights[j] > 0 ? share * share_a : 0.0f;
    const float b = candidate.points_b.weights[j] > 0 ? share * (1.0f - share_a) : 0.0f;
    sums->weights[j] += a + b;
    for (size_t c = 0; c < 3; ++c) {
      const size_t at = (pixel * 3 + c) * samples + j - pixel * samples;
      sums->values[at] += a * candidate.points_a.values[at] + b * candidate.points_b.values[at];
    }
  }
}

/// The candidates at the points, by the shares of their pixels; of the noisy layer the share alone.
FilteredPoints BlendPoints(const LayerState& state) {
  const SlicePoints& points = *state.points;
  const size_t samples = points.samples;
  FilteredPoints out;
  out.values.resize(points.pixels.size() * 3 * samples);
  out.weights.resize(points.pixels.size() * samples);
  for (size_t pixel = 0; pixel < points.pixels.size(); ++pixel) {
    const auto [x, y] = points.pixels[pixel];
    out.raw.push_back(state.shares[0].At(x, y));
    const float share_a = state.halves.share_a.At(x, y);
    for (size_t i = 0; i < state.candidates.size(); ++i)
      AddPoints(state.candidates[i], pixel, samples, state.shares[i + 1].At(x, y), share_a, &out);
    for (size_t c = 0; c < 3; ++c) {
      const float energy = state.firefly_energy.empty() ? 0.0f : state.firefly_energy[c].At(x, y);
      for (size_t j = 0; j < samples; ++j) {
        float& value = out.values[(pixel * 3 + c) * samples + j];
        const float weight = out.weights[pixel * samples + j];
        value = weight > 0 ? value / weight + energy : 0.0f;
      }
    }
  }
  return out;
}

void RunBlend(LayerState* state) {
  if (state->shares.empty()) {
    state->shares = MakePlanes(state->candidates.size() + 1, state->halves.width(), state->halves.height());
    state->shares.back().Fill(1);
  }
  state->result.planes = BlendPlanes(*state);
  if (state->points != nullptr) state->result.points = BlendPoints(*state);
}

void RunSingleFiltering(LayerState* state) {
  const Halves& halves = state->halves;
  const SingleFilteringParams& params = state->settings.single;
  const float sigma = std::max(NoiseLevel(halves, halves.a, halves.b, state->pool), kMinNoise * halves.level);
  const PatchBasis basis =
      FitPatchBasis(state->raw, halves.weight.view(), state->settings.patches, state->pool);
  const Planes geometry = SelectGeometry(state->geometry, state->settings);
  const Planes features =
      JointFeatures(state->raw, basis, params.range_factor * sigma, geometry, state->pool);
  ManifoldResult result = ManifoldFilterAtPoints(state->raw, features, halves.weight.view(), params.manifolds,
                                                 params.manifolds.sigma_s, state->points, state->pool);
  state->result.planes = std::move(result.filtered);
  if (state->points == nullptr) return;
  state->result.points = {std::move(result.points.values), std::move(result.points.weights),
                          std::vector<float>(state->points->pixels.size(), 0.0f)};
}

bool HasBothHalves(const LayerState& state) { return state.halves.has_noise_estimate; }
bool HasOneHalf(const LayerState& state) { return !state.halves.has_noise_estimate; }
bool HasCandidates(const LayerState& state) { return !state.candidates.empty(); }
bool Always(const LayerState&) { return true; }

constexpr char kManifoldSource[] = "Gastal & Oliveira 2012; Gruzdev et al. 2015";

StageInfo SingleFilteringInfo(std::string_view off_when) {
  return {.name = "single-filtering",
          .reads = "the layer's mean, geometry",
          .writes = "the filtered layer",
          .off_when = off_when,
          .source = kManifoldSource,
          .header = "filter/manifold/manifold_filter.h",
          .window_px = [](const Settings& s) { return BlurWindow(s.layer.single.manifolds.sigma_s); }};
}

/// The layer with its noise measured.
LayerState Open(const LayerSettings& settings, const Product& product, Halves halves,
                const SlicePoints* points, TaskPool* pool) {
  LayerState state{.settings = settings,
                   .geometry = product.geometry,
                   .points = points,
                   .pool = pool,
                   .halves = std::move(halves),
                   .raw = {},
                   .raw_variance = {},
                   .guide_noise = 0,
                   .removed = {},
                   .candidates = {},
                   .firefly_energy = {},
                   .shares = {},
                   .result = {}};
  const ConstFloatView share_a = state.halves.share_a.view();
  state.raw = Combine(state.halves.a, state.halves.b, share_a, pool);
  if (state.halves.has_noise_estimate)
    state.raw_variance = PixelVariance(state.halves.a, state.halves.b, share_a, pool);
  return state;
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
        .window_px = [](const Settings&) { return FireflyWindow(); }},
       [](const LayerState& s) { return HasBothHalves(s) && !s.halves.is_difference; },
       RunFireflies},
      {SingleFilteringInfo("both halves are known"), HasOneHalf, RunSingleFiltering},
      {{.name = "first-filtering",
        .reads = "halves, geometry",
        .writes = "candidate P, half by half",
        .off_when = "one half alone",
        .source = kManifoldSource,
        .header = "filter/manifold/manifold_filter.h",
        .window_px = [](const Settings& s) { return BlurWindow(s.layer.first_reach_px); }},
       HasBothHalves,
       RunFirstFiltering},
      {{.name = "second-filtering",
        .reads = "halves, P, geometry",
        .writes = "candidate P + M(half - P), half by half",
        .off_when = "one half alone",
        .source = "twicing: Tukey 1977",
        .header = "filter/manifold/manifold_filter.h",
        .window_px = [](const Settings& s) { return BlurWindow(s.layer.second_reach_px); }},
       HasCandidates,
       RunSecondFiltering},
      {{.name = "firefly-energy",
        .reads = "removed energy, P, geometry",
        .writes = "spread energy",
        .off_when = "nothing was removed",
        .source = "our own",
        .header = "filter/denoise/firefly.h",
        .window_px = [](const Settings&) { return BlurWindow(kSpreadReachPx); }},
       [](const LayerState& s) { return HasCandidates(s) && !s.removed.empty(); },
       RunFireflyEnergy},
      {{.name = "choice",
        .reads = "halves, candidates",
        .writes = "share of each candidate and of the noisy layer",
        .off_when = "one half alone; when switched off, the last candidate has all",
        .source = "Rousselle et al. 2012, by halves",
        .header = "filter/layers/selection.h",
        .window_px = [](const Settings& s) { return SelectionWindow(s.layer.selection); }},
       HasCandidates,
       RunChoice},
      {{.name = "blend",
        .reads = "noisy layer, candidates, shares, spread energy",
        .writes = "the filtered layer",
        .off_when = "one half alone",
        .source = "our own",
        .header = "filter/denoise/layer_stages.h",
        .is_required = true},
       HasBothHalves,
       RunBlend}};
  return stages;
}

const std::vector<LayerStage>& PublishedLayerStages() {
  static const std::vector<LayerStage> stages = {{SingleFilteringInfo("never"), Always, RunSingleFiltering}};
  return stages;
}

FilteredLayer RunLayer(const std::vector<LayerStage>& stages, const LayerSettings& settings,
                       const Product& product, const SlicePoints* points, const SwitchedOff& off,
                       const StageWatch& watch, TaskPool* pool) {
  Halves halves = HalvesOf(product, pool);
  if (halves.level == 0) {
    return {ClonePlanes(Crop(product.mean, product.box)),
            points != nullptr ? BlackPoints(*points, 0.0f) : FilteredPoints{}};
  }
  const float scale = halves.scale;
  LayerState state = Open(settings, product, std::move(halves), points, pool);
  for (const LayerStage& stage : stages) {
    if (IsOff(off, stage.info.name) || !stage.is_on(state)) continue;
    stage.run(&state);
    if (watch) watch(stage.info.name);
  }
  FilteredLayer result = std::move(state.result);
  if (result.planes.empty()) {  // its filtering is switched off
    result.planes = std::move(state.raw);
    if (points != nullptr) result.points = BlackPoints(*points, 1.0f);
  }
  if (points != nullptr) FitToPixels(*points, result.planes, &result.points);
  RestoreUnits(product, scale, pool, &result.planes);
  for (float& value : result.points.values) value *= scale;
  return result;
}

}  // namespace lumifold::filter
