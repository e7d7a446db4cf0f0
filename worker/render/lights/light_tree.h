#pragma once

#include <cstdint>
#include <vector>

#include "worker/scene/scene.h"

namespace lumifold::render {

/// Spatial and directional bounds of an emitter or of a group of emitters.
struct EmitterBounds {
  scene::Bounds box;
  scene::Vec3 axis = {0, 0, 1};  // unit; axis of the cone of normals
  float spread = 0;              // radians between the axis and the outermost normal; pi: all directions
  float falloff = 1.5707963f;    // radians from a normal beyond which nothing is emitted
  bool both_sides = false;       // emits along -axis as along axis
  double power = 0;              // 0: never sampled
};

/// The shading point that a light sample is for.
struct LightReceiver {
  scene::Vec3 position;
  scene::Vec3 normal;  // unit shading normal; light from behind counts too, because surfaces may transmit
};

/// Samples one of many emitters by its estimated contribution to a shading point. Nodes bound position,
/// directions and power of the emitters below. Every emitter that may contribute has a probability above 0.
/// The same emitters give the same tree on every machine. Threads: safe concurrently.
/// Source: Conty Estevez & Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree Splitting"
/// (bounds, cost, importance; without the splitting).
class LightTree {
 public:
  LightTree() = default;
  explicit LightTree(const std::vector<EmitterBounds>& emitters);

  bool IsEmpty() const { return nodes_.empty(); }

  struct Choice {
    uint32_t emitter = 0;
    float probability = 0;  // 0: the traversal ended at emitters that do not contribute
  };

  /// The emitter that `u` in [0, 1) selects.
  Choice Pick(const LightReceiver& receiver, float u) const;

  /// The probability with which Pick() returns `emitter` for this receiver.
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
    uint32_t link = 0;  // kLeaf | emitter, or index of the second child; the first follows its parent
  };

  struct Builder;

  static float Importance(const Node& node, const LightReceiver& receiver);
  /// The probability of an inner node's first child; below 0 if neither child can light the receiver. Pick()
  /// and Probability() must use the same bits.
  float FirstShare(uint32_t index, const LightReceiver& receiver) const;

  std::vector<Node> nodes_;
  /// By emitter: bit k is set if the path to its leaf takes the second child at depth k; kNotInTree: no leaf.
  std::vector<uint64_t> bit_trails_;
};

}  // namespace lumifold::render
