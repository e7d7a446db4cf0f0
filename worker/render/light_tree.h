#pragma once

#include <cstdint>
#include <vector>

#include "worker/scene/scene.h"

namespace lumifold::render {

/// Where an emitter is and which way it shines.
struct EmitterBounds {
  scene::Bounds box;
  scene::Vec3 axis = {0, 0, 1};  // unit; the middle of its normals
  float spread = 0;              // radians between the axis and the outermost normal; pi: every way
  float falloff = 1.5707963f;    // radians from a normal beyond which nothing is radiated
  bool both_sides = false;       // shines along -axis as along axis
  double power = 0;              // 0: never drawn
};

/// A point to be lit.
struct LightReceiver {
  scene::Vec3 position;
  scene::Vec3 normal;  // unit shading normal; light from behind counts as well, for surfaces may transmit
};

/// Chooses among many emitters by what each may give to a point: nodes bound place, directions and power of
/// those below. An emitter that may give anything has a probability above 0. The same tree on every machine.
/// Threads: safe concurrently. Source: Conty Estevez & Kulla 2018, "Importance Sampling of Many Lights with
/// Adaptive Tree Splitting" (bounds, cost, importance; without the splitting).
class LightTree {
 public:
  LightTree() = default;
  explicit LightTree(const std::vector<EmitterBounds>& emitters);

  bool IsEmpty() const { return nodes_.empty(); }

  struct Choice {
    uint32_t emitter = 0;
    float probability = 0;  // 0: the way down ended among emitters that give nothing
  };

  /// The emitter that `u` in [0, 1) picks.
  Choice Pick(const LightReceiver& receiver, float u) const;

  /// How often Pick() gives `emitter` there.
  float Probability(const LightReceiver& receiver, uint32_t emitter) const;

 private:
  static constexpr uint32_t kLeaf = 1u << 31;

  struct Node {
    scene::Vec3 center;  // of the box
    float radius = 0;    // half the diagonal of the box
    scene::Vec3 axis;
    float cos_spread = 1;
    float sin_spread = 0;
    float cos_falloff = 0;
    float power = 0;
    bool both_sides = false;
    uint32_t link = 0;  // kLeaf | emitter, or the second child; the first follows its parent
  };

  struct Builder;

  static float Importance(const Node& node, const LightReceiver& receiver);
  /// The probability of an inner node's first child; below 0 where neither child can light the receiver.
  /// Pick() and Probability() must take it alike, to the bit.
  float FirstShare(uint32_t index, const LightReceiver& receiver) const;

  std::vector<Node> nodes_;
  std::vector<uint64_t> trails_;  // an emitter's way down: bit k is the turn at depth k; kNowhere: not in it
};

}  // namespace lumifold::render
