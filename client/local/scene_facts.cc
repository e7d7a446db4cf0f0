#include "client/local/scene_facts.h"

#include <memory>
#include <thread>

#include "absl/strings/str_cat.h"
#include "filter/image/parallel.h"
#include "worker/plan/scene_memory.h"
#include "worker/scene/gltf_loader.h"

namespace lumifold::local {
namespace {

std::string LightText(const scene::PunctualLight& light) {
  using Kind = scene::PunctualLight::Kind;
  const char* const kind = light.kind == Kind::kPoint  ? "point"
                           : light.kind == Kind::kSpot ? "spot"
                                                       : "directional";
  return absl::StrCat(light.name, " (", kind, ")");
}

void AddGeometry(const scene::Scene& scene, client::SceneFacts* facts) {
  for (const scene::Mesh& mesh : scene.meshes)
    facts->triangles += static_cast<int64_t>(mesh.triangles.size() / 3);
  facts->instances = static_cast<int64_t>(scene.instances.size());
}

void AddTextures(const scene::Scene& scene, client::SceneFacts* facts) {
  facts->textures = static_cast<int64_t>(scene.images.size());
  for (const scene::SharedImage& image : scene.images) {
    if (image != nullptr) facts->texture_pixels += int64_t{image->width} * image->height;
  }
}

}  // namespace

absl::StatusOr<client::SceneFacts> ReadSceneFacts(const std::string& path) {
  const std::unique_ptr<TaskPool> pool = MakeTaskPool(static_cast<int>(std::thread::hardware_concurrency()));
  scene::LoadOptions options;
  options.pool = pool.get();
  const absl::StatusOr<scene::Scene> scene = scene::LoadGltfFile(path, options);
  if (!scene.ok()) return scene.status();
  client::SceneFacts facts;
  for (const scene::Camera& camera : scene->cameras) facts.cameras.push_back(camera.name);
  for (const scene::PunctualLight& light : scene->lights) facts.lights.push_back(LightText(light));
  facts.animations = scene->animations;
  facts.animation_seconds = scene->animation_duration;
  facts.variants = scene->variants;
  facts.extensions = scene->extensions;
  facts.materials = static_cast<int64_t>(scene->materials.size());
  facts.warnings = scene->warnings;
  AddGeometry(*scene, &facts);
  AddTextures(*scene, &facts);
  facts.memory_bytes = static_cast<int64_t>(plan::SceneMemory(*scene, 0, 0));
  return facts;
}

}  // namespace lumifold::local
