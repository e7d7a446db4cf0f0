#include "client/scene/camera_aspect.h"

#include <nlohmann/json.hpp>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "client/scene/assets.h"

namespace lumifold::client {
namespace {

using nlohmann::json;

/// The whole number under `key`, -1 without one.
int64_t IndexIn(const json& object, const char* key) {
  const auto found = object.is_object() ? object.find(key) : object.end();
  return found != object.end() && found->is_number_integer() ? found->get<int64_t>() : -1;
}

double NumberIn(const json& object, const char* key) {
  const auto found = object.is_object() ? object.find(key) : object.end();
  return found != object.end() && found->is_number() ? found->get<double>() : 0;
}

std::string NameIn(const json& object) {
  const auto found = object.is_object() ? object.find("name") : object.end();
  return found != object.end() && found->is_string() ? found->get<std::string>() : "";
}

/// The array under `key`, an empty one where there is none.
const json& ArrayIn(const json& object, const char* key) {
  static const json none = json::array();
  const auto found = object.is_object() ? object.find(key) : object.end();
  return found != object.end() && found->is_array() ? *found : none;
}

const json& ItemOf(const json& array, int64_t index) {
  static const json none = json::object();
  return index >= 0 && static_cast<size_t>(index) < array.size() ? array[static_cast<size_t>(index)] : none;
}

/// A camera as the worker numbers and names it.
struct NamedCamera {
  std::string name;
  const json* camera;
};

/// The cameras of a scene in the order of its nodes: each before its children.
class CameraWalk {
 public:
  explicit CameraWalk(const json& scene)
      : nodes_(ArrayIn(scene, "nodes")),
        cameras_(ArrayIn(scene, "cameras")),
        visited_(nodes_.size(), false) {}

  std::vector<NamedCamera> Run(const json& scene) {
    for (const int64_t root : RootsOf(scene)) Visit(root, 0);
    return std::move(found_);
  }

 private:
  static constexpr int kMaxDepth = 256;  // as the worker's

  std::vector<int64_t> RootsOf(const json& scene) const {
    const json& scenes = ArrayIn(scene, "scenes");
    std::vector<int64_t> roots;
    if (!scenes.empty()) {
      const int64_t chosen = IndexIn(scene, "scene");
      for (const json& root : ArrayIn(ItemOf(scenes, chosen < 0 ? 0 : chosen), "nodes"))
        roots.push_back(root.is_number_integer() ? root.get<int64_t>() : -1);
      return roots;
    }
    std::vector<bool> is_child(nodes_.size(), false);
    for (const json& node : nodes_) {
      for (const json& child : ArrayIn(node, "children")) {
        if (IsNode(child)) is_child[child.get<size_t>()] = true;
      }
    }
    for (size_t i = 0; i < nodes_.size(); ++i) {
      if (!is_child[i]) roots.push_back(static_cast<int64_t>(i));
    }
    return roots;
  }

  bool IsNode(const json& index) const {
    return index.is_number_integer() && index.get<int64_t>() >= 0 && index.get<uint64_t>() < nodes_.size();
  }

  void Visit(int64_t index, int depth) {
    if (index < 0 || static_cast<size_t>(index) >= nodes_.size() || depth >= kMaxDepth) return;
    if (visited_[static_cast<size_t>(index)]) return;
    visited_[static_cast<size_t>(index)] = true;
    const json& node = nodes_[static_cast<size_t>(index)];
    if (const int64_t number = IndexIn(node, "camera"); number >= 0) {
      const json& camera = ItemOf(cameras_, number);
      std::string name = NameIn(node);
      if (name.empty()) name = NameIn(camera);
      found_.push_back({name.empty() ? absl::StrCat("camera", number) : name, &camera});
    }
    for (const json& child : ArrayIn(node, "children")) {
      if (IsNode(child)) Visit(child.get<int64_t>(), depth + 1);
    }
  }

  const json& nodes_;
  const json& cameras_;
  std::vector<bool> visited_;
  std::vector<NamedCamera> found_;
};

const json* Chosen(const std::vector<NamedCamera>& cameras, const std::string& wanted) {
  if (cameras.empty()) return nullptr;
  if (wanted.empty()) return cameras.front().camera;
  for (const NamedCamera& camera : cameras) {
    if (camera.name == wanted) return camera.camera;
  }
  size_t number = 0;
  return absl::SimpleAtoi(wanted, &number) && number < cameras.size() ? cameras[number].camera : nullptr;
}

}  // namespace

std::optional<double> CameraAspectOf(const std::string& json_text, const std::string& camera) {
  const json scene = json::parse(json_text, /*cb=*/nullptr, /*allow_exceptions=*/false);
  const json* const chosen = Chosen(CameraWalk(scene).Run(scene), camera);
  if (chosen == nullptr) return std::nullopt;
  double aspect = 0;
  if (const auto seen = chosen->find("orthographic"); seen != chosen->end()) {
    aspect = NumberIn(*seen, "xmag") / NumberIn(*seen, "ymag");
  } else if (const auto perspective = chosen->find("perspective"); perspective != chosen->end()) {
    aspect = NumberIn(*perspective, "aspectRatio");
  }
  constexpr double kMost = 1e6;
  return aspect > 1 / kMost && aspect < kMost ? std::optional<double>(aspect) : std::nullopt;
}

absl::StatusOr<std::optional<double>> CameraAspect(const std::string& scene_path, const std::string& camera) {
  const absl::StatusOr<std::string> json_text = ReadSceneJson(scene_path);
  if (!json_text.ok())
    return absl::Status(json_text.status().code(), absl::StrCat("scene ", json_text.status().message()));
  return CameraAspectOf(*json_text, camera);
}

}  // namespace lumifold::client
