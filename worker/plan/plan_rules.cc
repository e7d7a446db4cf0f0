#include "worker/plan/plan_rules.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "filter/image/decisions.h"

namespace lumifold::plan {
namespace {

// --- Light and layers -------------------------------------------------------------------------------------

/// A level with less than this share of the radiance in every part of the picture is not kept apart. It is
/// below what 8 bits resolve.
constexpr double kMinLevelShare = 1e-3;

/// "24 bytes a pixel of each pass": 4 bytes for each channel.
std::string BytesSaved(int channels) {
  return absl::StrFormat("%d bytes a pixel of each pass", 4 * channels);
}

constexpr int kColor = 3;            // channels
constexpr int kHalves = 2 * kColor;  // channels of a layer that is kept in halves

bool HasDirectLight(const SceneFacts& facts) { return facts.lobes.diffuse && facts.HasLight(); }

/// Why light is never scattered twice; empty if it may be.
std::string NoBounce(const SceneFacts& facts) {
  if (facts.surfaces == 0 && !facts.animated) return "there are no surfaces";
  if (!facts.HasLight()) return "nothing emits light";
  if (facts.lobes.IsEmpty()) return "no material scatters light";
  if (facts.in_one_plane) return "all surfaces lie in one plane: none receives light from another";
  return "";
}

Verdict DecideBounces(const RuleInput& input, const Plan&) {
  const std::string none = NoBounce(input.facts);
  const int asked = input.settings.render.max_bounces;
  if (none.empty()) return {asked, Source::kScene, "light may be scattered from one surface to another", ""};
  return {0, Source::kScene, none, asked > 0 ? "scattered paths" : ""};
}

Verdict DecideLevels(const RuleInput& input, const Plan&) {
  const SceneFacts& facts = input.facts;
  if (!facts.lobes.delta) return {0, Source::kScene, "no material is a perfect mirror or smooth glass", ""};
  if (facts.delta_in_one_plane) {
    return {1, Source::kScene,
            absl::StrCat(facts.delta_material, " reflects or transmits without scattering, in one plane"),
            ""};
  }
  const std::string seen = absl::StrCat(facts.delta_material, " reflects or transmits without scattering");
  if (facts.animated) return {layers::kMaxDepth, Source::kScene, absl::StrCat(seen, "; it may move"), ""};
  int levels = layers::kMaxDepth;
  while (levels > 1 && input.probe.level_share[static_cast<size_t>(levels)] < kMinLevelShare) --levels;
  if (levels == layers::kMaxDepth) return {levels, Source::kScene, seen, ""};
  const double share = input.probe.level_share[static_cast<size_t>(levels) + 1];
  return {
      levels, Source::kProbe,
      absl::StrFormat("%s, but deeper levels have at most %.2g %% of the light anywhere", seen, 100 * share),
      "the channels of deeper levels"};
}

Verdict DecideDirect(const RuleInput& input, const Plan&) {
  const SceneFacts& facts = input.facts;
  if (!facts.lobes.diffuse) return {0, Source::kScene, "no material has a diffuse lobe", BytesSaved(kHalves)};
  if (!facts.HasLight()) return {0, Source::kScene, "nothing emits light", BytesSaved(kHalves)};
  return {1, Source::kScene, "light falls on diffuse materials", ""};
}

Verdict DecideIndirect(const RuleInput& input, const Plan& so_far) {
  if (!HasDirectLight(input.facts)) return DecideDirect(input, so_far);
  if (so_far.max_bounces == 0) {
    const std::string none = NoBounce(input.facts);
    return {0, Source::kScene, none.empty() ? "no bounces are traced" : none, BytesSaved(kHalves)};
  }
  return {1, Source::kScene, "light may be scattered to diffuse materials", ""};
}

Verdict DecideAlbedo(const RuleInput& input, const Plan&) {
  if (!input.facts.lobes.diffuse)
    return {0, Source::kScene, "no material has a diffuse lobe", BytesSaved(kColor)};
  return {1, Source::kScene, "it multiplies the light on diffuse materials", ""};
}

Verdict DecideEmission(const RuleInput& input, const Plan&) {
  const SceneFacts& facts = input.facts;
  if (facts.emitters) return {1, Source::kScene, "materials emit light", ""};
  if (facts.environment) return {1, Source::kScene, "the environment is visible", ""};
  return {0, Source::kScene, "no material emits and there is no environment", BytesSaved(kColor)};
}

Verdict DecideGlossy(const RuleInput& input, const Plan&) {
  const SceneFacts& facts = input.facts;
  if (!facts.lobes.glossy) {
    return {0, Source::kScene, "no material has a rough reflection, rough or diffuse transmission, or sheen",
            BytesSaved(kHalves + kColor)};
  }
  return {1, Source::kScene, absl::StrCat(facts.glossy_material, " has a glossy lobe"), ""};
}

// --- Code that is left out --------------------------------------------------------------------------------

Verdict DecideGeneralCode(const RuleInput& input, const Plan&) {
  const SceneFacts& facts = input.facts;
  if (!facts.IsDiffuseOnly())
    return {1, Source::kScene, absl::StrCat(facts.glossy_material, " has more than a diffuse lobe"), ""};
  return {0, Source::kScene, "all materials are diffuse, emit, or both",
          "the tables and the code of all other lobes"};
}

Verdict DecideEmissionOnHits(const RuleInput& input, const Plan& so_far) {
  Verdict verdict = DecideEmission(input, so_far);
  if (verdict.value == 0) verdict.saving = "the last ray of each path";
  return verdict;
}

Verdict DecideAlphaTests(const RuleInput& input, const Plan&) {
  const SceneFacts& facts = input.facts;
  if (facts.animated && facts.alpha_surfaces == 0)
    return {0, Source::kScene, "no surface of this frame has an alpha mode; each frame is looked at", ""};
  if (facts.alpha_surfaces == 0) return {0, Source::kScene, "no surface has an alpha mode or is clear", ""};
  if (facts.opaque_surfaces == 0) {
    return {0, Source::kScene,
            absl::StrFormat("all %d surfaces with alpha let rays pass somewhere", facts.alpha_surfaces), ""};
  }
  return {0, Source::kScene,
          absl::StrFormat("%d of %d surfaces with alpha are opaque in every texel", facts.opaque_surfaces,
                          facts.alpha_surfaces),
          absl::StrFormat("alpha tests on %d surfaces", facts.opaque_surfaces)};
}

// --- Units ------------------------------------------------------------------------------------------------

constexpr int kTile = 32;
constexpr int kMaxPlannedTile = 128;
/// The frames of a job have at least this many tiles together, so that many workers can share it.
constexpr int64_t kMinTiles = 64;
/// The probe has no more pixels, and the order is part of the plan.
constexpr int64_t kMaxOrderedTiles = kProbePixels;
/// Tiles whose costs differ by less than this factor are rendered in order of number.
constexpr double kMinCostRatio = 1.25;

int64_t TilesOf(const PlanSettings& settings, int size) {
  const auto across = [size](int edge) { return (int64_t{edge} + size - 1) / size; };
  return across(settings.render.width) * across(settings.render.height);
}

/// Of a whole tile of mean cost.
double SecondsPerSample(const RuleInput& input, int tile_size) {
  return double{1} * tile_size * tile_size * input.probe.RaysPerSample() / input.settings.rays_per_second;
}

/// Samples of a pass unless the plan makes it longer: the coordinator's default. Each pass costs the bytes of
/// its channels.
int DefaultPass(const PlanSettings& settings) {
  constexpr int kLeast = 64;
  constexpr int kMostPasses = 16;
  const int share = settings.samples / kMostPasses;
  return std::max(kLeast, share + share % 2);
}

/// A pass may be this many times the coordinator's default. Samples that are added to a job render its last
/// pass again.
constexpr int kMaxPassGrowth = 4;

// Neither tile size nor pass samples depend on the number of samples below 1024: a job to which samples are
// added has the units, and the bits, of one that was submitted with as many.

Verdict DecideTileSize(const RuleInput& input, const Plan&) {
  const int samples = DefaultPass(input.settings);
  int size = kTile;
  while (size < kMaxPlannedTile && samples * SecondsPerSample(input, size) < kMinUnitSeconds &&
         input.settings.frames * TilesOf(input.settings, 2 * size) >= kMinTiles)
    size *= 2;
  return {size, Source::kProbe,
          absl::StrFormat("%d samples take %.2g s in a tile of this size, %.2g s in one of %d", samples,
                          samples * SecondsPerSample(input, size), samples * SecondsPerSample(input, kTile),
                          kTile),
          size > kTile ? absl::StrFormat("%d of %d units in each pass",
                                         TilesOf(input.settings, kTile) - TilesOf(input.settings, size),
                                         TilesOf(input.settings, kTile))
                       : ""};
}

Verdict DecidePassSamples(const RuleInput& input, const Plan& so_far) {
  const double seconds = SecondsPerSample(input, so_far.units.tile_size);
  const int least = DefaultPass(input.settings);
  int samples = least;
  while (samples < kMaxPassGrowth * least && samples * seconds < kMinUnitSeconds) samples *= 2;
  const auto passes = [&](int of) { return (input.settings.samples + of - 1) / of; };
  return {samples, Source::kProbe, absl::StrFormat("a unit of as many takes %.2g s", samples * seconds),
          passes(samples) < passes(least)
              ? absl::StrFormat("%d of %d passes", passes(least) - passes(samples), passes(least))
              : ""};
}

/// Rays per sample of each tile.
std::vector<double> TileCosts(const RuleInput& input, int size) {
  const int width = input.settings.render.width;
  const int height = input.settings.render.height;
  std::vector<double> costs;
  for (int y = 0; y < height; y += size) {
    for (int x = 0; x < width; x += size) {
      const Rect rect = {x, y, std::min(x + size, width), std::min(y + size, height)};
      const double pixels = static_cast<double>(rect.width()) * rect.height();
      costs.push_back(pixels * input.probe.RaysPerSample(rect, width, height));
    }
  }
  return costs;
}

Verdict DecideCostliestFirst(const RuleInput& input, const Plan& so_far) {
  if (TilesOf(input.settings, so_far.units.tile_size) > kMaxOrderedTiles) {
    return {0, Source::kProbe,
            absl::StrFormat("the probe does not tell more than %d tiles apart", kMaxOrderedTiles), ""};
  }
  const std::vector<double> costs = TileCosts(input, so_far.units.tile_size);
  const auto [least, most] = std::minmax_element(costs.begin(), costs.end());
  const std::string reason =
      absl::StrFormat("tiles take %.2g to %.2g s for each sample", *least / input.settings.rays_per_second,
                      *most / input.settings.rays_per_second);
  if (*most < kMinCostRatio * *least) return {0, Source::kProbe, reason, ""};
  return {1, Source::kProbe, reason, "waiting for the last unit"};
}

// --- The table --------------------------------------------------------------------------------------------

/// Applies a switch to one field of a plan's part.
template <auto Part, auto Field>
void Switch(int value, Plan* plan) {
  (plan->*Part).*Field = value != 0;
}

template <bool render::TracingPlan::Layers::* Field>
void SwitchLayer(int value, Plan* plan) {
  plan->tracing.layers.*Field = value != 0;
}

using Layers = render::TracingPlan::Layers;

const Rule kRules[] = {
    {decisions::kBounces, DecideBounces, [](int value, Plan* plan) { plan->max_bounces = value; }},
    {decisions::kLevels, DecideLevels, [](int value, Plan* plan) { plan->tracing.levels = value; }},
    {decisions::kDirect, DecideDirect, SwitchLayer<&Layers::direct>},
    {decisions::kIndirect, DecideIndirect, SwitchLayer<&Layers::indirect>},
    {decisions::kAlbedo, DecideAlbedo, SwitchLayer<&Layers::albedo>},
    {decisions::kEmission, DecideEmission, SwitchLayer<&Layers::emission>},
    {decisions::kGlossy, DecideGlossy, SwitchLayer<&Layers::glossy>},
    {"general-code", DecideGeneralCode,
     [](int value, Plan* plan) { plan->tracing.diffuse_code = value == 0; }},
    {"emission-on-hits", DecideEmissionOnHits,
     Switch<&Plan::tracing, &render::TracingPlan::emission_on_hits>},
    {"alpha-by-mode", DecideAlphaTests,
     [](int value, Plan* plan) { plan->tracing.opacity_scan = value == 0; }},
    {decisions::kTileSize, DecideTileSize, [](int value, Plan* plan) { plan->units.tile_size = value; }},
    {decisions::kPassSamples, DecidePassSamples,
     [](int value, Plan* plan) { plan->units.pass_samples = value; }},
    {decisions::kCostliestFirst, DecideCostliestFirst, Switch<&Plan::units, &UnitPlan::costliest_first>},
};
static_assert(std::size(kRules) == decisions::kAll.size());

}  // namespace

std::span<const Rule> Rules() { return kRules; }

std::vector<int> CostliestFirst(const RuleInput& input, const Plan& plan) {
  if (input.settings.full || TilesOf(input.settings, plan.units.tile_size) > kMaxOrderedTiles) return {};
  const std::vector<double> costs = TileCosts(input, plan.units.tile_size);
  std::vector<int> order(costs.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
    return costs[static_cast<size_t>(a)] > costs[static_cast<size_t>(b)];
  });
  return order;
}

}  // namespace lumifold::plan
