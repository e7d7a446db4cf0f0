#pragma once

#include <array>
#include <cstdint>

#include "filter/image/layers.h"
#include "worker/scene/scene.h"
#include "worker/scene/vec.h"

namespace lumifold::render {

/// Contribution of one camera sample at one level of one branch.
struct LevelSample {
  scene::Vec3 direct;  // D and I as at the first surface, albedo left out
  scene::Vec3 indirect;
  scene::Vec3 albedo;        // the chain's throughput times the surface's diffuse albedo
  scene::Vec3 emitted;       // the chain's throughput times the emission of the surface or the environment
  bool has_diffuse = false;  // whether a surface with a diffuse lobe was hit
};

/// Values by level with a bit for each value that is set, so that a sample without mirrors does not pay for
/// them.
template <typename Value>
class ByLevel {
 public:
  /// The level's value, marked as set; default-constructed if it was not set before.
  Value& Set(layers::Level level) {
    if (!IsSet(level)) {
      values_[level.index()] = Value{};
      set_ |= 1u << level.index();
    }
    return values_[level.index()];
  }
  bool IsSet(layers::Level level) const { return (set_ >> level.index() & 1u) != 0; }
  const Value& operator[](layers::Level level) const { return values_[level.index()]; }

  /// Whether no value is set.
  bool IsEmpty() const { return set_ == 0; }
  void Clear() { set_ = 0; }

  /// Calls visit(level, value) for each value that is set, in order of index.
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

/// The surface that a camera ray hits first, as GeometrySample has it.
struct FirstHit {
  int instance = scene::kNone;  // kNone: nothing is hit
  scene::Vec3 normal;           // shading normal, towards the camera
  float distance = 0;           // along the ray
  float roughness = 1;          // GGX alpha of the reflecting lobe; 1 if there is none
};

/// A surface of ShadowCatchers that the camera sees, and what a sample of the lights brings it, as luminance
/// of irradiance.
struct CaughtShadow {
  bool is_hit = false;
  float light = 0;   // with nothing in between
  float shadow = 0;  // the part of it that does not arrive
};

/// One camera sample in layers. To float rounding
///   combined = (direct + indirect) * albedo + emitted + glossy * glossy_albedo
///              + sum over levels of ((direct + indirect) * albedo + emitted) + remainder.
struct LayerSample {
  scene::Vec3 combined;  // C: the path's whole radiance
  scene::Vec3 direct;    // D: direct light scattered by the first surface's diffuse lobe, albedo left out
  scene::Vec3 indirect;  // I: the same for indirect light
  scene::Vec3 albedo;    // T
  scene::Vec3 emitted;   // E: emitted by the first surface
  scene::Vec3 glossy;    // G: light scattered by the first surface's glossy lobes, over S
  scene::Vec3 glossy_albedo;  // S: the directional albedo of those lobes
  scene::Vec3 remainder;      // all else: glossy lobes seen in mirrors, and light after the last level
  FirstHit first;
  CaughtShadow caught;
  ByLevel<LevelSample> levels;

  void Clear() {
    combined = direct = indirect = albedo = emitted = glossy = glossy_albedo = remainder = {};
    levels.Clear();
    first = {};
    caught = {};
  }
};

/// Whether no value is NaN or infinite.
bool IsFinite(scene::Vec3 value);
bool IsFinite(const LayerSample& sample);

}  // namespace lumifold::render
