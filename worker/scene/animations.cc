#include "worker/scene/animations.h"

#include <algorithm>
#include <map>
#include <set>
#include <span>
#include <string>
#include <tuple>
#include <utility>

#include "absl/strings/str_cat.h"
#include "worker/scene/accessors.h"
#include "worker/scene/choice.h"
#include "worker/scene/keyframes.h"
#include "worker/scene/pointers.h"

namespace lumifold::scene {
namespace {

/// The layout of one channel's values in their accessor.
struct ValueLayout {
  int width = 1;              // components of an element
  size_t elements = 1;        // per value
  size_t values_per_key = 1;  // 3 for cubic splines: in-tangent, value, out-tangent
  size_t ElementsPerKey() const { return elements * values_per_key; }
  size_t FloatsPerValue() const { return elements * static_cast<size_t>(width); }
};

/// The number of morph targets of the node's mesh, taken from its first primitive: all primitives have the
/// same.
size_t MorphTargetCount(const tinygltf::Model& model, const tinygltf::Node& node) {
  if (node.mesh < 0 || static_cast<size_t>(node.mesh) >= model.meshes.size()) return 0;
  const auto& primitives = model.meshes[node.mesh].primitives;
  return primitives.empty() ? 0 : primitives.front().targets.size();
}

Vec4 QuaternionAt(std::span<const float> values) { return {values[0], values[1], values[2], values[3]}; }

/// Poses one document.
class Poser {
 public:
  Poser(const LoadOptions& options, Document* document, Diagnostics* diagnostics)
      : time_(options.time_seconds),
        keyframes_left_(options.limits.max_keyframes),
        document_(document),
        diagnostics_(diagnostics) {}

  absl::StatusOr<AnimationSummary> Run() {
    for (size_t a = 0; a < document_->animations.size(); ++a) {
      if (auto s = Play(a); !s.ok()) return s;
    }
    return Finish();
  }

  absl::StatusOr<AnimationSummary> RunOne(const std::string& wanted) {
    std::vector<std::string> names;
    for (const Animation& animation : document_->animations) names.push_back(animation.name);
    const auto chosen = Choose("animation", names, wanted);
    if (!chosen.ok()) return chosen.status();
    if (auto s = Play(static_cast<size_t>(*chosen)); !s.ok()) return s;
    return Finish();
  }

 private:
  using Property = std::tuple<int, AnimatedProperty, std::string>;  // of a node, or the pointer

  static Property PropertyOf(const AnimationChannel& c) { return {c.node, c.property, c.pointer}; }

  absl::StatusOr<AnimationSummary> Finish() {
    if (pointed_.empty()) return summary_;
    if (auto s = SetPointedValues(pointed_, document_); !s.ok()) return s;
    return summary_;
  }

  /// Whether an animation that plays moves what this one moves.
  bool IsAlternative(const Animation& animation) const {
    return std::any_of(animation.channels.begin(), animation.channels.end(),
                       [this](const AnimationChannel& c) { return moved_.contains(PropertyOf(c)); });
  }

  absl::Status Play(size_t number) {
    const Animation& animation = document_->animations[number];
    const std::string place = Place("animation", static_cast<int64_t>(number), animation.name);
    if (IsAlternative(animation)) {
      diagnostics_->Count("animations that move what another one moves do not play (--animation chooses one)",
                          place);
      return absl::OkStatus();
    }
    for (size_t c = 0; c < animation.channels.size(); ++c) {
      const AnimationChannel& channel = animation.channels[c];
      const bool is_pointed = channel.property == AnimatedProperty::kPointed;
      if (auto s = is_pointed ? ApplyPointed(channel) : Apply(channel, place); !s.ok())
        return WithContext(s, absl::StrCat(place, " channel ", c));
    }
    for (const AnimationChannel& channel : animation.channels) moved_.insert(PropertyOf(channel));
    return absl::OkStatus();
  }

  absl::Status Apply(const AnimationChannel& channel, const std::string& place) {
    auto& nodes = document_->model.nodes;
    if (channel.node < 0 || static_cast<size_t>(channel.node) >= nodes.size()) {
      return absl::InvalidArgumentError(
          absl::StrCat("node ", channel.node, " does not exist (there are ", nodes.size(), ")"));
    }
    tinygltf::Node& node = nodes[channel.node];
    if (!node.matrix.empty() && channel.property != AnimatedProperty::kWeights) {
      diagnostics_->Count("animations of nodes that have a matrix left out", place);
      return absl::OkStatus();
    }
    const ValueLayout layout = LayoutOf(channel, node);
    if (layout.elements == 0) {
      diagnostics_->Count("animations of morph weights without morph targets left out", place);
      return absl::OkStatus();
    }
    const auto values = ValuesNow(channel, layout);
    if (!values.ok()) return values.status();
    Destination(channel.property, &node)->assign(values->begin(), values->end());
    return absl::OkStatus();
  }

  absl::Status ApplyPointed(const AnimationChannel& channel) {
    ValueLayout layout;
    layout.width = FindPointer(channel.pointer)->numbers;
    if (channel.interpolation == Interpolation::kCubicSpline) layout.values_per_key = 3;
    auto values = ValuesNow(channel, layout);
    if (!values.ok()) return values.status();
    pointed_.push_back({channel.pointer, *std::move(values)});
    return absl::OkStatus();
  }

  absl::StatusOr<std::vector<float>> ValuesNow(const AnimationChannel& channel, const ValueLayout& layout) {
    const auto times = Times(channel.times);
    if (!times.ok()) return times.status();
    auto values = Sample(channel, layout, **times);
    if (!values.ok()) return values.status();
    summary_.moves = summary_.moves || (*times)->size() > 1;
    summary_.duration_seconds = std::max(summary_.duration_seconds, double{(*times)->back()});
    return values;
  }

  ValueLayout LayoutOf(const AnimationChannel& channel, const tinygltf::Node& node) const {
    ValueLayout layout;
    if (channel.property == AnimatedProperty::kWeights) {
      layout.elements = MorphTargetCount(document_->model, node);
    } else {
      layout.width = channel.property == AnimatedProperty::kRotation ? 4 : 3;
    }
    if (channel.interpolation == Interpolation::kCubicSpline) layout.values_per_key = 3;
    return layout;
  }

  static std::vector<double>* Destination(AnimatedProperty property, tinygltf::Node* node) {
    switch (property) {
      case AnimatedProperty::kTranslation:
        return &node->translation;
      case AnimatedProperty::kRotation:
        return &node->rotation;
      case AnimatedProperty::kScale:
        return &node->scale;
      case AnimatedProperty::kWeights:
      case AnimatedProperty::kPointed:
        break;
    }
    return &node->weights;
  }

  /// Keyframe times. Each accessor is read once, because exporters share it among all channels of an object.
  absl::StatusOr<const std::vector<float>*> Times(int accessor) {
    const auto known = times_.find(accessor);
    if (known != times_.end()) return &known->second;
    const auto count = ElementCount(*document_, accessor);
    if (!count.ok()) return count.status();
    if (*count > static_cast<size_t>(keyframes_left_)) {
      return absl::ResourceExhaustedError("more keyframes than the limit allows");
    }
    keyframes_left_ -= static_cast<int64_t>(*count);
    auto times = ReadFloats(*document_, accessor, 1, 0, *count);
    if (!times.ok()) return times.status();
    if (times->empty()) return absl::InvalidArgumentError("no keyframes");
    if (!std::is_sorted(times->begin(), times->end())) {
      return absl::InvalidArgumentError(absl::StrCat("accessor ", accessor, ": keyframe times decrease"));
    }
    return &times_.emplace(accessor, *std::move(times)).first->second;
  }

  absl::StatusOr<std::vector<float>> Sample(const AnimationChannel& channel, const ValueLayout& layout,
                                            const std::vector<float>& times) const {
    const auto count = ElementCount(*document_, channel.values);
    if (!count.ok()) return count.status();
    if (*count / layout.ElementsPerKey() < times.size()) {
      return absl::InvalidArgumentError(absl::StrCat("accessor ", channel.values, ": ", *count,
                                                     " elements for ", times.size(), " keyframes of ",
                                                     layout.ElementsPerKey()));
    }
    const KeyframeSpan span = FindKeyframes(times, time_);
    const auto floats =
        ReadFloats(*document_, channel.values, layout.width, span.left * layout.ElementsPerKey(),
                   (span.right - span.left + 1) * layout.ElementsPerKey());
    if (!floats.ok()) return floats.status();
    std::vector<float> values = Interpolated(channel, layout, span, *floats);
    if (channel.property == AnimatedProperty::kRotation) {
      const Vec4 unit = UnitQuaternion(QuaternionAt(values));
      values = {unit.x, unit.y, unit.z, unit.w};
    }
    return values;
  }

  /// `floats` holds all values of the keyframes of `span`.
  static std::vector<float> Interpolated(const AnimationChannel& channel, const ValueLayout& layout,
                                         const KeyframeSpan& span, std::span<const float> floats) {
    const size_t size = layout.FloatsPerValue();
    const auto value = [&](size_t i) { return floats.subspan(i * size, size); };
    const bool is_cubic = channel.interpolation == Interpolation::kCubicSpline;
    const auto left = value(is_cubic ? 1 : 0);
    if (span.left == span.right || channel.interpolation == Interpolation::kStep) {
      return {left.begin(), left.end()};
    }
    if (is_cubic) return CubicBetween(span, left, value(2), value(3), value(4));
    if (channel.property != AnimatedProperty::kRotation) return LinearBetween(left, value(1), span.fraction);
    const Vec4 q = SphericalBetween(UnitQuaternion(QuaternionAt(left)),
                                    UnitQuaternion(QuaternionAt(value(1))), span.fraction);
    return {q.x, q.y, q.z, q.w};
  }

  double time_;
  int64_t keyframes_left_;
  Document* document_;
  Diagnostics* diagnostics_;
  std::map<int, std::vector<float>> times_;
  std::set<Property> moved_;
  std::vector<PointedValue> pointed_;
  AnimationSummary summary_;
};

}  // namespace

absl::StatusOr<AnimationSummary> PoseNodes(const LoadOptions& options, Document* document,
                                           Diagnostics* diagnostics) {
  Poser poser(options, document, diagnostics);
  return options.animation.empty() ? poser.Run() : poser.RunOne(options.animation);
}

}  // namespace lumifold::scene
