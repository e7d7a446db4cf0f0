#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "nlohmann/json_fwd.hpp"
#include "worker/scene/diagnostics.h"

/// Animations and skins of a document. tinygltf does not parse them, because it requires fields that are
/// optional in glTF (a skin's inverse bind matrices, a channel's node).
namespace lumifold::scene {

enum class AnimatedProperty { kTranslation, kRotation, kScale, kWeights, kPointed };
enum class Interpolation { kStep, kLinear, kCubicSpline };

/// One property over time. Indices of accessors and nodes are as in the file, not checked.
struct AnimationChannel {
  int node = -1;        // of all properties but kPointed
  std::string pointer;  // of kPointed: one that FindPointer() knows
  AnimatedProperty property = AnimatedProperty::kTranslation;
  Interpolation interpolation = Interpolation::kLinear;
  int times = -1;   // accessor of keyframe times, seconds
  int values = -1;  // accessor of keyframe values
};

struct Animation {
  std::string name;
  std::vector<AnimationChannel> channels;
};

struct Skin {
  std::string name;
  std::vector<int> joints;         // nodes
  int inverse_bind_matrices = -1;  // accessor; -1: identities
};

/// Reads the section "animations". Channels without a node are left out, and those of properties that neither
/// core glTF nor KHR_animation_pointer with FindPointer() animates; the latter are counted. Errors:
/// kInvalidArgument naming the animation and channel.
absl::Status ParseAnimations(const nlohmann::json& section, std::vector<Animation>* animations,
                             Diagnostics* diagnostics);

/// Reads the section "skins". Errors: kInvalidArgument naming the skin.
absl::Status ParseSkins(const nlohmann::json& section, std::vector<Skin>* skins);

}  // namespace lumifold::scene
