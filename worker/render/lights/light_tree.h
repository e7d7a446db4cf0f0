#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
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
  double intensity = 0;          // greatest, W/sr; 0: never sampled
};

/// The shading point that a light sample is for.
struct LightReceiver {
  scene::Vec3 position;
  scene::Vec3 normal;     // unit shading normal
  bool transmits = true;  // light from behind counts too
};

/// What the importance of an emitter, or of a group of them, depends on; see importance-inl.h.
struct LightExtent {
  scene::Vec3 center;  // of the box
  float radius = 0;    // half the diagonal of the box
  scene::Vec3 axis;
  float cos_spread = 1;
  float sin_spread = 0;
  float cos_falloff = 0;
  float intensity = 0;
  float both_sides = 0;  // 1: it emits along -axis as along axis
};

/// Emitters that are compared one by one: a row for each number, so that compilers make vectors of them.
struct LightLeaf {
  /// At most; 16 cost about as much as four levels of inner nodes, and pick better.
  static constexpr size_t kSize = 16;
  using Row = std::array<float, kSize>;

  Row x = {}, y = {}, z = {}, radius = {}, axis_x = {}, axis_y = {}, axis_z = {}, cos_spread = {},
      sin_spread = {}, cos_falloff = {}, intensity = {}, both_sides = {};
  std::array<uint32_t, kSize> emitters = {};
  size_t count = 0;

  void Add(const LightExtent& extent, uint32_t emitter);
  LightExtent At(size_t slot) const {
    return {{x[slot], y[slot], z[slot]},
            radius[slot],
            {axis_x[slot], axis_y[slot], axis_z[slot]},
            cos_spread[slot],
            sin_spread[slot],
            cos_falloff[slot],
            intensity[slot],
            both_sides[slot]};
  }
  /// The importance of each emitter, and their sum.
  struct Weights {
    Row of;
    float sum;
  };
  Weights Weigh(LightReceiver receiver) const;
};

/// Samples one of several emitters by its estimated contribution to a shading point. Nodes bound position,
/// directions and intensity of the emitters below; a leaf compares up to LightLeaf::kSize emitters one by
/// one. Every emitter that may contribute has a probability above 0. The same emitters give the same tree
/// on every machine. Threads: safe concurrently.
/// Source: Conty Estevez & Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree Splitting"
/// (bounds, cost, importance; without the splitting).
class LightTree {
 public:
  LightTree() = default;
  explicit LightTree(const std::vector<EmitterBounds>& emitters);

  bool IsEmpty() const { return nodes_.empty(); }
  /// The leaf that has all emitters; null if there are more of them, or none.
  const LightLeaf* OnlyLeaf() const { return nodes_.size() == 1 ? leaves_.data() : nullptr; }

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
    LightExtent extent;
    uint32_t link =
        0;  // kLeaf | number of the leaf, or index of the second child; the first follows its parent
  };
  /// Where an emitter is.
  struct Place {
    uint64_t bit_trail = 0;  // bit k is set if the path to its leaf takes the second child at depth k
    int slot = -1;           // in the leaf; below 0: it is in none
  };

  struct Builder;

  static LightExtent ExtentOf(const EmitterBounds& bounds);
  /// The probability of an inner node's first child; below 0 if neither child can light the receiver. Pick()
  /// and Probability() must use the same bits.
  float FirstShare(uint32_t index, const LightReceiver& receiver) const;

  std::vector<Node> nodes_;
  std::vector<LightLeaf> leaves_;
  std::vector<Place> places_;  // by emitter
};

}  // namespace lumifold::render
