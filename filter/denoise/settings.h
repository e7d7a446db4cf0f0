#pragma once

#include <string_view>
#include <variant>
#include <vector>

#include "filter/denoise/firefly.h"
#include "filter/layers/choice.h"
#include "filter/layers/product.h"
#include "filter/manifold/fit_call.h"
#include "filter/manifold/manifold_filter.h"
#include "filter/manifold/nlm_space.h"

namespace lumifold::filter {

/// One filtering of a layer's mean, without candidates to choose from. The defaults are the paper's.
struct SingleFilteringParams {
  float range_factor = 1.8f;  // sigma_q over the layer's noise
  ManifoldParams manifolds;
};

/// How one layer is filtered. The defaults are those of the "default" method.
struct LayerSettings {
  PatchParams patches;                           // of the noisy layer
  PatchParams second_patches = {1, 3, 6, 0.95};  // of the first filtering's result
  float range_factor = 1.8f;  // sigma_q of the first filtering, over the noise of the half that guides
  float knee = 0.2f;          // of the stabilised guide, over the layer's mean
  // The manifolds of all filterings are close to each other, since they have to follow fine detail.
  ManifoldParams first_manifolds = {
      .sigma_s = 7, .height = 5, .cell = 4, .keeps_mass = true, .is_first_order = true};
  float reach_px = 16;  // of the blur along the manifolds, of all filterings and of the energy of fireflies
  /// Of the further filterings of what the first one leaves: sigma_q over the noise of the half that guides,
  /// from the widest to the narrowest.
  std::vector<float> twicing_ranges = {0.6f, 0.3f};
  ManifoldParams twicing_manifolds = {.sigma_s = 2, .height = 3, .keeps_mass = true};
  /// Range of the features that a fragment shares with its pixel, whose patch mixes surfaces, over that of
  /// its own.
  float mixed_range = 2;
  FireflyParams fireflies;
  ChoiceParams choice;
  RegressionParams regression;  // of its light, and of the frame
  /// Where one half alone is known, its noise is a rough guess, and geometry guides far better than patches.
  SingleFilteringParams single = {.range_factor = 8,
                                  .manifolds = {.sigma_s = 8, .height = 5, .keeps_mass = true}};
};

/// How a frame is filtered.
struct Settings {
  LayerSettings layer;
  ProductParams products;
  /// Glossy albedo above which nearly all light of a pixel is glossy: what it mirrors tells such pixels
  /// apart, the features do not. They are mixed pixels.
  float mixed_albedo = 0.5f;
};

/// The "default" method's settings.
Settings DefaultSettings();

/// A number of the default method that was chosen by measurement. Halving and doubling it has a meaning.
struct TunedConstant {
  using Number = std::variant<float*, double*, int*>;

  std::string_view name;
  std::string_view unit;  // "" for a pure number; the height of a tree counts as the number of its manifolds
  Number (*at)(Settings&);

  float Get(Settings settings) const;
  /// Rounds what has to be whole.
  void Set(Settings* settings, float value) const;
};

/// All tuned constants of the default method. What is not among them are limits that keep numbers finite, and
/// sizes of blocks and cells.
const std::vector<TunedConstant>& TunedConstants();

}  // namespace lumifold::filter
