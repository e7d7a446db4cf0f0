#include "worker/scene/nodes.h"

#include <cmath>
#include <numeric>
#include <utility>

#include "absl/strings/str_cat.h"
#include "filter/image/portable_math.h"
#include "worker/scene/accessors.h"
#include "worker/scene/fields.h"
#include "worker/scene/lights.h"
#include "worker/scene/transforms.h"

namespace lumifold::scene {
namespace {

constexpr char kInstancing[] = "EXT_mesh_gpu_instancing";
constexpr char kLights[] = "KHR_lights_punctual";
constexpr char kVisibility[] = "KHR_node_visibility";

/// Whether the node says that it and all nodes below it are to be seen.
bool IsVisible(const tinygltf::Node& node) {
  const tinygltf::Value* const extension = FindExtension(node.extensions, kVisibility);
  if (extension == nullptr || !extension->Has("visible")) return true;
  const tinygltf::Value& visible = extension->Get("visible");
  return !visible.IsBool() || visible.Get<bool>();
}

absl::Status CheckIndex(int index, size_t size, const char* kind) {
  if (index >= 0 && static_cast<size_t>(index) < size) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(kind, " ", index, " does not exist (there are ", size, ")"));
}

absl::StatusOr<std::vector<int>> RootNodes(const tinygltf::Model& model) {
  if (model.defaultScene != kNone || !model.scenes.empty()) {
    const int scene = model.defaultScene == kNone ? 0 : model.defaultScene;
    if (auto s = CheckIndex(scene, model.scenes.size(), "scene"); !s.ok()) return s;
    return model.scenes[scene].nodes;
  }
  std::vector<bool> is_child(model.nodes.size());
  for (const tinygltf::Node& node : model.nodes) {
    for (const int child : node.children) {
      if (child >= 0 && static_cast<size_t>(child) < is_child.size()) is_child[child] = true;
    }
  }
  std::vector<int> roots;
  for (size_t i = 0; i < is_child.size(); ++i) {
    if (!is_child[i]) roots.push_back(static_cast<int>(i));
  }
  return roots;
}

absl::Status ReadLens(const tinygltf::Camera& source, Camera* camera) {
  const bool is_orthographic = source.type == "orthographic";
  const auto is_positive = [](double value) { return value > 1e-6 && value < 1e6; };
  if (is_orthographic) {
    if (!is_positive(source.orthographic.xmag) || !is_positive(source.orthographic.ymag)) {
      return absl::InvalidArgumentError("xmag and ymag must be positive");
    }
    camera->kind = Camera::Kind::kOrthographic;
    camera->xmag = static_cast<float>(source.orthographic.xmag);
    camera->ymag = static_cast<float>(source.orthographic.ymag);
    camera->aspect = camera->xmag / camera->ymag;
    return absl::OkStatus();
  }
  if (!is_positive(source.perspective.yfov) || !(source.perspective.yfov < double{kPi})) {
    return absl::InvalidArgumentError("yfov must lie between 0 and pi");
  }
  const double aspect = source.perspective.aspectRatio;
  if (aspect != 0 && !is_positive(aspect)) return absl::InvalidArgumentError("aspectRatio must be positive");
  camera->yfov = static_cast<float>(source.perspective.yfov);
  camera->aspect = static_cast<float>(aspect);
  return absl::OkStatus();
}

/// The attributes of EXT_mesh_gpu_instancing on one node; empty if missing.
struct InstanceAttributes {
  std::vector<Vec3> translations;
  std::vector<Vec4> rotations;
  std::vector<Vec3> scales;
  size_t count = 0;
};

/// Reads attribute `name` with `read` and checks that all attributes have the same count.
template <typename Read, typename Vec>
absl::Status ReadInstanceAttribute(const Document& document, const tinygltf::Value& attributes,
                                   const char* name, Read read, int64_t limit, InstanceAttributes* out,
                                   std::vector<Vec>* values) {
  if (!attributes.Has(name)) return absl::OkStatus();
  if (!attributes.Get(name).IsInt())
    return absl::InvalidArgumentError(absl::StrCat(name, " is not an accessor"));
  const int accessor = attributes.Get(name).Get<int>();
  const auto count = ElementCount(document, accessor);
  if (!count.ok()) return count.status();
  if (*count > static_cast<size_t>(limit))
    return absl::ResourceExhaustedError("more instances than the limit allows");
  if (out->count != 0 && out->count != *count) {
    return absl::InvalidArgumentError(absl::StrCat(name, " has ", *count, " elements, others ", out->count));
  }
  auto read_values = read(document, accessor);
  if (!read_values.ok()) return read_values.status();
  *values = *std::move(read_values);
  out->count = *count;
  return absl::OkStatus();
}

absl::StatusOr<std::vector<Affine>> ReadInstances(const Document& document, const tinygltf::Value& extension,
                                                  int64_t limit) {
  if (!extension.Has("attributes") || !extension.Get("attributes").IsObject()) {
    return absl::InvalidArgumentError("no attributes");
  }
  const tinygltf::Value& attributes = extension.Get("attributes");
  InstanceAttributes a;
  auto s = ReadInstanceAttribute(document, attributes, "TRANSLATION", ReadVec3s, limit, &a, &a.translations);
  if (s.ok()) s = ReadInstanceAttribute(document, attributes, "ROTATION", ReadVec4s, limit, &a, &a.rotations);
  if (s.ok()) s = ReadInstanceAttribute(document, attributes, "SCALE", ReadVec3s, limit, &a, &a.scales);
  if (!s.ok()) return s;
  std::vector<Affine> instances;
  instances.reserve(a.count);
  for (size_t i = 0; i < a.count; ++i) {
    const auto instance = AffineFromTrs(a.translations.empty() ? Vec3{} : a.translations[i],
                                        a.rotations.empty() ? Vec4{0, 0, 0, 1} : a.rotations[i],
                                        a.scales.empty() ? Vec3{1, 1, 1} : a.scales[i]);
    if (!instance.ok()) return WithContext(instance.status(), absl::StrCat("instance ", i));
    instances.push_back(*instance);
  }
  return instances;
}

/// Traverses a scene's nodes.
class NodeWalk {
 public:
  /// `origin`: of the contents.
  NodeWalk(const Document& document, const Point64& origin, const LoadLimits& limits,
           Diagnostics* diagnostics)
      : document_(document),
        model_(document.model),
        limits_(limits),
        diagnostics_(diagnostics),
        parents_(model_.nodes.size(), kNotVisited) {
    contents_.world_from_node.resize(model_.nodes.size());
    contents_.origin = origin;
  }

  absl::StatusOr<NodeContents> Run() {
    const auto roots = RootNodes(model_);
    if (!roots.ok()) return roots.status();
    for (const int root : *roots) {
      if (auto s = Visit(root, kNone, {}, 1, /*visible=*/true); !s.ok()) return s;
    }
    return std::move(contents_);
  }

 private:
  static constexpr int kNotVisited = -2;

  /// A node's transform, and its place before contents_.origin is subtracted.
  struct World {
    Affine from_node;
    Point64 place = {};
  };

  World Compose(const World& parent, const tinygltf::Node& node, const Affine& local) const {
    World world = {parent.from_node * local, parent.place};
    const Point64 step = LocalOrigin(node);
    for (int i = 0; i < 3; ++i) {
      const Affine& axes = parent.from_node;
      world.place[i] +=
          double{axes.x[i]} * step[0] + double{axes.y[i]} * step[1] + double{axes.z[i]} * step[2];
    }
    if (contents_.origin == Point64{}) return world;
    const auto near = [&](int i) { return static_cast<float>(world.place[i] - contents_.origin[i]); };
    world.from_node.origin = {near(0), near(1), near(2)};
    return world;
  }

  /// Recursion is bounded by limits_.max_node_depth.
  absl::Status Visit(int index, int parent, const World& parent_world, int depth, bool visible) {
    if (auto s = CheckIndex(index, model_.nodes.size(), "node"); !s.ok()) return s;
    const tinygltf::Node& node = model_.nodes[index];
    const std::string place = Place("node", index, node.name);
    if (auto s = Enter(index, parent, depth); !s.ok()) return WithContext(s, place);
    const auto local = LocalTransform(node);
    if (!local.ok()) return WithContext(local.status(), place);
    const World world = Compose(parent_world, node, *local);
    const Affine& world_from_node = world.from_node;
    contents_.world_from_node[index] = world_from_node;
    visible = visible && IsVisible(node);
    if (auto s = AddContents(index, world_from_node, visible, place); !s.ok()) return WithContext(s, place);
    for (const int child : node.children) {
      if (auto s = Visit(child, index, world, depth + 1, visible); !s.ok()) return s;
    }
    return absl::OkStatus();
  }

  absl::Status Enter(int index, int parent, int depth) {
    if (depth > limits_.max_node_depth) {
      return absl::ResourceExhaustedError(
          absl::StrCat("nested deeper than ", limits_.max_node_depth, " nodes"));
    }
    for (int ancestor = parent; ancestor != kNone; ancestor = parents_[ancestor]) {
      if (ancestor == index) return absl::InvalidArgumentError("is its own ancestor (a cycle)");
    }
    if (parents_[index] != kNotVisited) return absl::InvalidArgumentError("has more than one parent");
    parents_[index] = parent;
    return absl::OkStatus();
  }

  /// A hidden node shows neither mesh nor light; its camera still looks.
  absl::Status AddContents(int index, const Affine& world_from_node, bool visible, const std::string& place) {
    const tinygltf::Node& node = model_.nodes[index];
    if (node.mesh != kNone && visible) {
      if (auto s = AddMesh(index, world_from_node, place); !s.ok()) return s;
    }
    if (node.camera != kNone) {
      if (auto s = AddCamera(node, world_from_node, place); !s.ok()) return s;
    }
    if (const auto* extension = FindExtension(node.extensions, kLights); extension != nullptr && visible) {
      return AddLight(*extension, node.name, world_from_node, place);
    }
    return absl::OkStatus();
  }

  absl::Status AddMesh(int index, const Affine& world_from_node, const std::string& place) {
    const tinygltf::Node& node = model_.nodes[index];
    if (auto s = CheckIndex(node.mesh, model_.meshes.size(), "mesh"); !s.ok()) return s;
    if (node.skin != kNone) {
      if (auto s = CheckIndex(node.skin, document_.skins.size(), "skin"); !s.ok()) return s;
      return AddPlacement(index, Affine{}, place);
    }
    const auto extension = node.extensions.find(kInstancing);
    if (extension == node.extensions.end()) return AddPlacement(index, world_from_node, place);
    const auto instances = ReadInstances(document_, extension->second, limits_.max_instances);
    if (!instances.ok()) return WithContext(instances.status(), kInstancing);
    for (const Affine& node_from_instance : *instances) {
      if (auto s = AddPlacement(index, world_from_node * node_from_instance, place); !s.ok()) return s;
    }
    return absl::OkStatus();
  }

  absl::Status AddPlacement(int index, const Affine& world_from_object, const std::string& place) {
    if (!IsInvertible(world_from_object)) {
      diagnostics_->Count("instances flattened or thrown out of space by their transform left out", place);
      return absl::OkStatus();
    }
    if (static_cast<int64_t>(contents_.placements.size()) >= limits_.max_instances) {
      return absl::ResourceExhaustedError(absl::StrCat("more than ", limits_.max_instances, " instances"));
    }
    const tinygltf::Node& node = model_.nodes[index];
    const std::string& name = node.name.empty() ? model_.meshes[node.mesh].name : node.name;
    contents_.placements.push_back({node.mesh, index, world_from_object, name});
    return absl::OkStatus();
  }

  absl::Status AddCamera(const tinygltf::Node& node, const Affine& world_from_node,
                         const std::string& place) {
    if (auto s = CheckIndex(node.camera, model_.cameras.size(), "camera"); !s.ok()) return s;
    const tinygltf::Camera& source = model_.cameras[node.camera];
    if (!IsInvertible(world_from_node)) {
      diagnostics_->Count("cameras flattened by their transform left out", place);
      return absl::OkStatus();
    }
    Camera camera;
    // Artists see and select the object, which exporters write as the node.
    camera.name = !node.name.empty()     ? node.name
                  : !source.name.empty() ? source.name
                                         : absl::StrCat("camera", node.camera);
    if (auto s = ReadLens(source, &camera); !s.ok())
      return WithContext(s, Place("camera", node.camera, source.name));
    camera.world_from_camera = RigidPart(world_from_node);
    contents_.cameras.push_back(std::move(camera));
    return absl::OkStatus();
  }

  absl::Status AddLight(const tinygltf::Value& extension, const std::string& node_name,
                        const Affine& world_from_node, const std::string& place) {
    const int index =
        extension.Has("light") && extension.Get("light").IsInt() ? extension.Get("light").Get<int>() : kNone;
    if (auto s = CheckIndex(index, model_.lights.size(), "light"); !s.ok()) return s;
    const tinygltf::Light& source = model_.lights[index];
    if (!IsInvertible(world_from_node)) {
      diagnostics_->Count("lights flattened by their transform left out", place);
      return absl::OkStatus();
    }
    const std::string light_place = Place("light", index, source.name);
    auto light = ReadLight(source, light_place, diagnostics_);
    if (!light.ok()) return light.status();
    light->name = node_name.empty() ? source.name : node_name;
    light->world_from_light = RigidPart(world_from_node);
    contents_.lights.push_back(*std::move(light));
    return absl::OkStatus();
  }

  const Document& document_;
  const tinygltf::Model& model_;
  const LoadLimits& limits_;
  Diagnostics* diagnostics_;
  std::vector<int> parents_;  // of each node visited
  NodeContents contents_;
};

/// Whole metres near the first camera, or the first mesh, of a scene far from its origin; 0 of others.
Point64 OriginOf(const NodeContents& contents) {
  constexpr float kFar = 1000;  // metres: floats there are .06 mm apart
  Vec3 place;
  if (!contents.cameras.empty())
    place = contents.cameras.front().world_from_camera.origin;
  else if (!contents.placements.empty())
    place = contents.placements.front().world_from_object.origin;
  if (std::fabs(place.x) < kFar && std::fabs(place.y) < kFar && std::fabs(place.z) < kFar) return {};
  return {std::round(double{place.x}), std::round(double{place.y}), std::round(double{place.z})};
}

}  // namespace

absl::StatusOr<NodeContents> WalkNodes(const Document& document, const LoadLimits& limits,
                                       Diagnostics* diagnostics) {
  Diagnostics found = *diagnostics;
  auto contents = NodeWalk(document, {}, limits, &found).Run();
  if (!contents.ok()) return contents;
  const Point64 origin = OriginOf(*contents);
  if (origin != Point64{}) return NodeWalk(document, origin, limits, diagnostics).Run();
  *diagnostics = std::move(found);
  return contents;
}

}  // namespace lumifold::scene
