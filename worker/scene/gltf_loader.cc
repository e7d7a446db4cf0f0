#include "worker/scene/gltf_loader.h"

#include <algorithm>
#include <exception>
#include <filesystem>
#include <map>
#include <new>
#include <stdexcept>
#include <tuple>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "filter/image/file_io.h"
#include "worker/scene/animations.h"
#include "worker/scene/document.h"
#include "worker/scene/extensions.h"
#include "worker/scene/geometry.h"
#include "worker/scene/materials.h"
#include "worker/scene/nodes.h"
#include "worker/scene/out_of_memory.h"
#include "worker/scene/skins.h"
#include "worker/scene/variants.h"

namespace lumifold::scene {
namespace {

constexpr int64_t kMaxFileBytes = int64_t{1} << 36;

/// A glTF mesh with one deformation; nodes with the same deformation share it.
struct Shape {
  int mesh = kNone;
  int skin = kNone;
  std::vector<double> morph_weights;  // empty: all 0
  friend bool operator<(const Shape& a, const Shape& b) {
    return std::tie(a.mesh, a.skin, a.morph_weights) < std::tie(b.mesh, b.skin, b.morph_weights);
  }
};

/// The Scene's meshes of one shape.
struct MeshRange {
  int first = 0;
  int count = 0;
};

bool IsShadowCatcher(const tinygltf::Node& node) {
  if (!node.extras.IsObject() || !node.extras.Has(kShadowCatcher)) return false;
  const tinygltf::Value& value = node.extras.Get(kShadowCatcher);
  if (value.IsBool()) return value.Get<bool>();
  return value.IsNumber() && value.GetNumberAsDouble() != 0;
}

/// Reads each shape that is placed at least once, and creates the instances.
class InstanceReader {
 public:
  InstanceReader(const Document& document, const NodeContents& contents, int variant,
                 const LoadOptions& options, Scene* scene, Diagnostics* diagnostics)
      : document_(document),
        contents_(contents),
        variant_(variant),
        options_(options),
        skins_(document, contents.world_from_node),
        geometry_(document, scene->materials, options.limits, diagnostics),
        scene_(scene),
        diagnostics_(diagnostics) {}

  absl::Status Run() {
    std::map<Shape, MeshRange> shapes;
    for (const Placement& placement : contents_.placements) shapes.try_emplace(ShapeOf(placement));
    for (auto& [shape, range] : shapes) {
      const auto read = ReadShape(shape);
      if (!read.ok()) return read.status();
      range = *read;
    }
    for (const Placement& placement : contents_.placements) {
      if (auto s = AddInstances(placement, shapes[ShapeOf(placement)]); !s.ok()) return s;
    }
    return absl::OkStatus();
  }

 private:
  Shape ShapeOf(const Placement& placement) const {
    const tinygltf::Node& node = document_.model.nodes[placement.node];
    Shape shape{placement.mesh, node.skin, {}};
    const auto& weights =
        node.weights.empty() ? document_.model.meshes[placement.mesh].weights : node.weights;
    const auto is_zero = [](double weight) { return weight == 0; };
    if (!std::all_of(weights.begin(), weights.end(), is_zero)) shape.morph_weights = weights;
    return shape;
  }

  absl::StatusOr<MeshRange> ReadShape(const Shape& shape) {
    const tinygltf::Mesh& source = document_.model.meshes[shape.mesh];
    Deformation deformation;
    deformation.morph_weights = shape.morph_weights;
    if (shape.skin != kNone) {
      const auto maps = skins_.WorldFromBind(shape.skin);
      if (!maps.ok()) return maps.status();
      deformation.world_from_bind = *maps;
    }
    MeshRange range{static_cast<int>(scene_->meshes.size()), 0};
    for (size_t p = 0; p < source.primitives.size(); ++p) {
      const std::string place = absl::StrCat(Place("mesh", shape.mesh, source.name), " primitive ", p);
      if (auto s = ReadPrimitive(source.primitives[p], deformation, place); !s.ok()) return s;
    }
    range.count = static_cast<int>(scene_->meshes.size()) - range.first;
    return range;
  }

  absl::Status ReadPrimitive(const tinygltf::Primitive& primitive, const Deformation& deformation,
                             const std::string& place) {
    const int material = MaterialOf(primitive, variant_);
    if (material < kNone || material >= static_cast<int>(scene_->materials.size())) {
      return absl::InvalidArgumentError(absl::StrCat(
          place, ": material ", material, " does not exist (there are ", scene_->materials.size(), ")"));
    }
    auto mesh = geometry_.Read(primitive, material, deformation, place);
    if (!mesh.ok()) return mesh.status();
    if (mesh->has_value()) scene_->meshes.push_back(**std::move(mesh));
    return absl::OkStatus();
  }

  absl::Status AddInstances(const Placement& placement, const MeshRange& range) {
    const size_t present = scene_->instances.size() + scene_->catchers.size();
    const int64_t limit = options_.limits.max_instances;
    if (static_cast<int64_t>(present) + range.count > limit)
      return absl::ResourceExhaustedError(absl::StrCat("more than ", limit, " instances"));
    const bool is_catcher = IsShadowCatcher(document_.model.nodes[placement.node]);
    if (is_catcher && !options_.catches_shadows)
      diagnostics_->Count(
          "shadow catchers shown like other surfaces, because the background is not transparent",
          Place("node", placement.node, placement.name));
    std::vector<Instance>& instances =
        is_catcher && options_.catches_shadows ? scene_->catchers : scene_->instances;
    for (int m = range.first; m < range.first + range.count; ++m)
      instances.push_back({m, placement.world_from_object, placement.name});
    return absl::OkStatus();
  }

  const Document& document_;
  const NodeContents& contents_;
  const int variant_;
  const LoadOptions& options_;
  SkinTable skins_;
  GeometryReader geometry_;
  Scene* scene_;
  Diagnostics* diagnostics_;
};

/// Squares and cubes of positions up to 1e9 fit a float.
absl::Status CheckExtent(const Scene& scene) {
  constexpr float kMaxCoordinate = 1e9f;
  const Bounds bounds = WorldBounds(scene);
  if (bounds.IsEmpty()) return absl::OkStatus();
  const Vec3 low = bounds.min, high = bounds.max;
  const bool inside = low.x >= -kMaxCoordinate && low.y >= -kMaxCoordinate && low.z >= -kMaxCoordinate &&
                      high.x <= kMaxCoordinate && high.y <= kMaxCoordinate && high.z <= kMaxCoordinate;
  if (inside) return absl::OkStatus();
  return absl::InvalidArgumentError("geometry reaches beyond 1e9 metres");
}

absl::StatusOr<Scene> LoadUnguarded(std::string_view bytes, const AssetReader& reader,
                                    const LoadOptions& options) {
  Diagnostics diagnostics;
  const LoadLimits& limits = options.limits;
  auto document = ParseDocument(bytes, reader, &diagnostics);
  if (!document.ok()) return document.status();
  const tinygltf::Model& model = document->model;
  auto s = CheckExtensions(model.extensionsUsed, model.extensionsRequired, &diagnostics);
  if (!s.ok()) return s;
  const auto animation = PoseNodes(options, &*document, &diagnostics);
  if (!animation.ok()) return animation.status();
  Scene scene;
  scene.extensions = model.extensionsUsed;
  scene.variants = VariantNames(model);
  for (const Animation& clip : document->animations) scene.animations.push_back(clip.name);
  const auto variant = FindVariant(scene.variants, options.variant);
  if (!variant.ok()) return variant.status();
  auto contents = WalkNodes(*document, limits, &diagnostics);
  if (!contents.ok()) return contents.status();
  scene.origin = contents->origin;
  scene.animated = animation->moves;
  scene.animation_duration = animation->duration_seconds;
  scene.cameras = std::move(contents->cameras);
  scene.lights = std::move(contents->lights);
  s = ReadMaterials(*document, MaterialsInUse(model, *variant), reader, options, &scene, &diagnostics);
  if (s.ok()) s = InstanceReader(*document, *contents, *variant, options, &scene, &diagnostics).Run();
  if (s.ok()) s = CheckExtent(scene);
  if (!s.ok()) return s;
  if (scene.cameras.empty()) diagnostics.Note("no camera: one that sees everything is used");
  if (scene.instances.empty()) diagnostics.Note("no triangles: there is nothing to see");
  scene.warnings = diagnostics.Lines();
  return scene;
}

/// Removes the prefix of nlohmann_json's messages, "[json.exception.parse_error.101] ".
std::string WithoutTag(const std::string& message) {
  const size_t end = message.find("] ");
  return message.starts_with("[json.exception.") && end != std::string::npos ? message.substr(end + 2)
                                                                             : message;
}

/// Converts exceptions, all of them from libraries, to a Status. The only place that does so.
absl::StatusOr<Scene> LoadGuarded(std::string_view bytes, const AssetReader& reader,
                                  const LoadOptions& options) {
  try {
    return LoadUnguarded(bytes, reader, options);
  } catch (const std::bad_alloc&) {
    return OutOfMemory("the scene");
  } catch (const std::length_error&) {
    return absl::ResourceExhaustedError("an array is larger than any memory");
  } catch (const std::exception& e) {
    return absl::InvalidArgumentError(absl::StrCat("malformed glTF: ", WithoutTag(e.what())));
  }
}

}  // namespace

absl::StatusOr<Scene> LoadGltf(std::string_view bytes, const std::string& name, const AssetReader& reader,
                               const LoadOptions& options) {
  auto scene = LoadGuarded(bytes, reader, options);
  if (scene.ok()) return scene;
  const absl::Status& s = scene.status();
  return absl::Status(s.code(), OneLine(absl::StrCat(name, ": ", s.message())));
}

absl::StatusOr<Scene> LoadGltfFile(const std::string& path, const LoadOptions& options) {
  const auto bytes = ReadFile(path, kMaxFileBytes);
  if (!bytes.ok()) return bytes.status();
  const std::filesystem::path folder = std::filesystem::path(path).parent_path();
  const AssetReader reader = [&folder](const std::string& uri) -> absl::StatusOr<std::string> {
    const std::filesystem::path asset(uri);
    if (asset.is_absolute() || uri.find("://") != std::string::npos) {
      return absl::InvalidArgumentError(absl::StrCat(uri, " is not a path relative to the scene"));
    }
    return ReadFile((folder / asset).string(), kMaxFileBytes);
  };
  return LoadGltf(*bytes, path, reader, options);
}

}  // namespace lumifold::scene
