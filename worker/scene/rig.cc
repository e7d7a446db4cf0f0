#include "worker/scene/rig.h"

#include <optional>
#include <utility>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "nlohmann/json.hpp"
#include "worker/scene/pointers.h"

namespace lumifold::scene {
namespace {

using nlohmann::json;

std::string StringOr(const json& object, const char* key, const std::string& otherwise) {
  const auto found = object.find(key);
  return found != object.end() && found->is_string() ? found->get<std::string>() : otherwise;
}

/// Member `key` as an index; nullopt if it is missing. It fits an int: all numbers of the document are
/// checked.
absl::StatusOr<std::optional<int>> Index(const json& object, const char* key) {
  const auto found = object.find(key);
  if (found == object.end()) return std::nullopt;
  if (!found->is_number_integer()) return absl::InvalidArgumentError(absl::StrCat(key, " is not an index"));
  return found->get<int>();
}

absl::StatusOr<int> RequiredIndex(const json& object, const char* key) {
  const auto index = Index(object, key);
  if (!index.ok()) return index.status();
  if (!index->has_value()) return absl::InvalidArgumentError(absl::StrCat("no ", key));
  return **index;
}

/// Member `key`, an array of objects.
absl::StatusOr<const json*> Objects(const json& object, const char* key) {
  const auto found = object.find(key);
  if (found == object.end() || !found->is_array())
    return absl::InvalidArgumentError(absl::StrCat("no ", key));
  for (const json& element : *found) {
    if (!element.is_object())
      return absl::InvalidArgumentError(absl::StrCat(key, " holds something else than objects"));
  }
  return &*found;
}

std::optional<AnimatedProperty> PropertyFrom(const std::string& path) {
  if (path == "translation") return AnimatedProperty::kTranslation;
  if (path == "rotation") return AnimatedProperty::kRotation;
  if (path == "scale") return AnimatedProperty::kScale;
  if (path == "weights") return AnimatedProperty::kWeights;
  return std::nullopt;
}

absl::StatusOr<Interpolation> InterpolationFrom(const std::string& name) {
  if (name == "LINEAR") return Interpolation::kLinear;
  if (name == "STEP") return Interpolation::kStep;
  if (name == "CUBICSPLINE") return Interpolation::kCubicSpline;
  return absl::InvalidArgumentError(absl::StrCat("interpolation \"", name, "\" is not glTF's"));
}

/// Reads the channel's sampler.
absl::Status ReadSampler(const json& samplers, int index, AnimationChannel* channel) {
  if (index < 0 || static_cast<size_t>(index) >= samplers.size()) {
    return absl::InvalidArgumentError(
        absl::StrCat("sampler ", index, " does not exist (there are ", samplers.size(), ")"));
  }
  const json& sampler = samplers[static_cast<size_t>(index)];
  const auto input = RequiredIndex(sampler, "input"), output = RequiredIndex(sampler, "output");
  if (!input.ok()) return input.status();
  if (!output.ok()) return output.status();
  const auto interpolation = InterpolationFrom(StringOr(sampler, "interpolation", "LINEAR"));
  if (!interpolation.ok()) return interpolation.status();
  channel->times = *input;
  channel->values = *output;
  channel->interpolation = *interpolation;
  return absl::OkStatus();
}

constexpr char kLeftOut[] = "animations of other things than nodes and morph weights left out";

/// The number in "/nodes/7/translation"; nullopt for other pointers.
std::optional<int> NodeOf(const std::string& pointer) {
  const std::string pattern = PatternOf(pointer);
  constexpr std::string_view kNodes = "/nodes/#/";
  if (!pattern.starts_with(kNodes) || !PropertyFrom(pattern.substr(kNodes.size())).has_value())
    return std::nullopt;
  return std::stoi(pointer.substr(kNodes.size() - 2));
}

/// The target of KHR_animation_pointer; nullopt for one that the renderer does not have.
std::optional<AnimationChannel> PointedTarget(const json& target, const std::string& place,
                                              Diagnostics* diagnostics) {
  const json::json_pointer at("/extensions/KHR_animation_pointer/pointer");
  const std::string pointer = target.contains(at) && target[at].is_string() ? target[at] : "";
  AnimationChannel channel;
  if (const std::optional<int> node = NodeOf(pointer); node.has_value()) {
    channel.node = *node;
    channel.property = *PropertyFrom(pointer.substr(pointer.rfind('/') + 1));
    return channel;
  }
  channel.property = AnimatedProperty::kPointed;
  channel.pointer = pointer;
  if (FindPointer(pointer).has_value()) return channel;
  diagnostics->Count(
      pointer.empty() ? kLeftOut : absl::StrCat("animations of ", OneLine(PatternOf(pointer)), " left out"),
      place);
  return std::nullopt;
}

/// The target of core glTF; nullopt without a node or of an unknown property.
absl::StatusOr<std::optional<AnimationChannel>> NodeTarget(const json& target, const std::string& place,
                                                           Diagnostics* diagnostics) {
  const auto node = Index(target, "node");
  if (!node.ok()) return node.status();
  const auto property = PropertyFrom(StringOr(target, "path", ""));
  if (!property.has_value()) {
    diagnostics->Count(kLeftOut, place);
    return std::nullopt;
  }
  if (!node->has_value()) return std::nullopt;  // glTF: to be ignored
  AnimationChannel channel;
  channel.node = **node;
  channel.property = *property;
  return channel;
}

/// nullopt for a channel whose target is left out.
absl::StatusOr<std::optional<AnimationChannel>> ParseChannel(const json& source, const json& samplers,
                                                             const std::string& place,
                                                             Diagnostics* diagnostics) {
  const auto target = source.find("target");
  if (target == source.end() || !target->is_object()) return absl::InvalidArgumentError("no target");
  using Channel = absl::StatusOr<std::optional<AnimationChannel>>;
  Channel channel = StringOr(*target, "path", "") == "pointer"
                        ? Channel(PointedTarget(*target, place, diagnostics))
                        : NodeTarget(*target, place, diagnostics);
  if (!channel.ok() || !channel->has_value()) return channel;
  const auto sampler = RequiredIndex(source, "sampler");
  if (!sampler.ok()) return sampler.status();
  if (auto s = ReadSampler(samplers, *sampler, &**channel); !s.ok()) return s;
  return channel;
}

absl::Status ParseAnimation(const json& source, const std::string& place, Animation* animation,
                            Diagnostics* diagnostics) {
  const auto channels = Objects(source, "channels"), samplers = Objects(source, "samplers");
  if (!channels.ok()) return channels.status();
  if (!samplers.ok()) return samplers.status();
  for (size_t i = 0; i < (*channels)->size(); ++i) {
    auto channel = ParseChannel((**channels)[i], **samplers, place, diagnostics);
    if (!channel.ok()) return WithContext(channel.status(), absl::StrCat("channel ", i));
    if (channel->has_value()) animation->channels.push_back(**channel);
  }
  return absl::OkStatus();
}

absl::Status ParseSkin(const json& source, Skin* skin) {
  const auto matrices = Index(source, "inverseBindMatrices");
  if (!matrices.ok()) return matrices.status();
  skin->inverse_bind_matrices = matrices->value_or(-1);
  const auto joints = source.find("joints");
  if (joints == source.end() || !joints->is_array() || joints->empty()) {
    return absl::InvalidArgumentError("no joints");
  }
  for (const json& joint : *joints) {
    if (!joint.is_number_integer()) return absl::InvalidArgumentError("a joint that is not an index");
    skin->joints.push_back(joint.get<int>());
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status ParseAnimations(const json& section, std::vector<Animation>* animations,
                             Diagnostics* diagnostics) {
  for (const json& source : section) {
    Animation animation{StringOr(source, "name", ""), {}};
    const std::string place = Place("animation", static_cast<int64_t>(animations->size()), animation.name);
    if (auto s = ParseAnimation(source, place, &animation, diagnostics); !s.ok())
      return WithContext(s, place);
    animations->push_back(std::move(animation));
  }
  return absl::OkStatus();
}

absl::Status ParseSkins(const json& section, std::vector<Skin>* skins) {
  for (const json& source : section) {
    Skin skin{StringOr(source, "name", ""), {}, -1};
    if (auto s = ParseSkin(source, &skin); !s.ok()) {
      return WithContext(s, Place("skin", static_cast<int64_t>(skins->size()), skin.name));
    }
    skins->push_back(std::move(skin));
  }
  return absl::OkStatus();
}

}  // namespace lumifold::scene
