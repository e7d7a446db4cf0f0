#pragma once

#include <array>
#include <cstdint>

#include "filter/image/layers.h"
#include "worker/scene/vec.h"

namespace lumifold::render {

/// What one camera sample finds at one level of one branch.
struct LevelSample {
  scene::Vec3 direct;  // D and I as at the first surface, its albedo left out
  scene::Vec3 indirect;
  scene::Vec3 albedo;        // the chain's throughput times the surface's diffuse albedo
  scene::Vec3 emitted;       // the chain's throughput times what the surface or the sky radiates
  bool has_diffuse = false;  // whether a surface with a diffuse lobe was met
};

/// Values by level, of which few or none are set: those that are carry a mark, so that a sample without
/// mirrors pays nothing for them.
template <typename Value>
class ByLevel {
 public:
  /// The level's value, marked as set; as new where it was not.
  Value& Set(layers::Level level) {
    if (!IsSet(level)) {
      values_[level.index()] = Value{};
      set_ |= 1u << level.index();
    }
    return values_[level.index()];
  }
  bool IsSet(layers::Level level) const { return (set_ >> level.index() & 1u) != 0; }
  const Value& operator[](layers::Level level) const { return values_[level.index()]; }

  /// Whether none is set.
  bool IsEmpty() const { return set_ == 0; }
  void Clear() { set_ = 0; }

  /// Calls visit(level, value) for each that is set, in order of index.
  template <typename Visit>
  void ForEach(Visit visit) const {
    for (size_t i = 0; set_ >> i != 0; ++i) {
      if ((set_ >> i & 1u) != 0) visit(layers::Level::Of(i), values_[i]);
    }
  }

 private:
  uint32_t set_ = 0;
  std::array<Value, layers::kLevelCount> values_;
};

/// One camera sample in layers. To float rounding
///   combined = (direct + indirect) * albedo + emitted + glossy * specular
///              + sum over levels of ((direct + indirect) * albedo + emitted) + tail.
struct LayerSample {
  scene::Vec3 combined;  // C: the path's whole radiance
  scene::Vec3 direct;    // D: the first surface's diffuse reflection, albedo left out, of light that came in
                         // one step
  scene::Vec3 indirect;  // I: the same of light that came by longer ways
  scene::Vec3 albedo;    // T
  scene::Vec3 emitted;   // E: radiated by the first surface itself
  scene::Vec3 glossy;  // G: what the first surface's other lobes reflect, mirrors and glass left out, over S
  scene::Vec3 specular;  // S: the directional albedo of those lobes
  scene::Vec3 tail;      // all else: glossy lobes behind a mirror, and what lies past the last level
  ByLevel<LevelSample> levels;

  void Clear() {
    combined = direct = indirect = albedo = emitted = glossy = specular = tail = {};
    levels.Clear();
  }
};

/// (D + I) T + E + G S + levels + tail: equals `combined` to rounding.
scene::Vec3 Recombined(const LayerSample& sample);

/// Whether no value is NaN or infinite.
bool IsFinite(scene::Vec3 value);
bool IsFinite(const LayerSample& sample);

}  // namespace lumifold::render
