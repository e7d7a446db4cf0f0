#pragma once

#include <string_view>

#include "filter/image/layers.h"

namespace lumifold::render {

/// What a renderer models of a scene. The default models everything. What may be left out for which scene:
/// see docs/plan.md.
struct TracingPlan {
  /// Levels that are kept apart, 0 to layers::kMaxDepth. Light of deeper levels is traced all the same and
  /// belongs to the remainder.
  int levels = layers::kMaxDepth;
  /// Scenes whose only lobe is diffuse get no table of reflection; others are not affected. The result has
  /// the same bits.
  bool diffuse_code = false;
  /// Meshes whose textures and vertex colours cut out nothing are opaque in spite of their alpha mode. The
  /// result has the same bits.
  bool opacity_scan = false;
  /// false: sampled directions gather no emission. For scenes in which nothing emits but punctual lights the
  /// result has the same bits.
  bool emission_on_hits = true;
  using Layers = lumifold::layers::Carried;
  Layers layers;  // that units carry besides C

  friend bool operator==(const TracingPlan&, const TracingPlan&) = default;
};

}  // namespace lumifold::render
