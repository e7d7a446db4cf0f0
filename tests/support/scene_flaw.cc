#include "tests/support/scene_flaw.h"

#include <cmath>

namespace lumifold::scene {
namespace {

bool IsFinite(Vec3 v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

bool IsFinite(const Affine& a) {
  return IsFinite(a.x) && IsFinite(a.y) && IsFinite(a.z) && IsFinite(a.origin);
}

bool IsIndex(int index, size_t size) { return index >= 0 && static_cast<size_t>(index) < size; }

bool IsIndexOrNone(int index, size_t size) { return index == kNone || IsIndex(index, size); }

bool IsUnit(Vec3 v) { return std::fabs(Length(v) - 1) < 1e-4f; }

std::string MeshFlaw(const Mesh& mesh, const Scene& scene) {
  const size_t count = mesh.positions.size();
  if (mesh.triangles.empty() || mesh.triangles.size() % 3 != 0) return "a mesh without whole triangles";
  for (const uint32_t corner : mesh.triangles) {
    if (corner >= count) return "a vertex index out of range";
  }
  for (const size_t size : {mesh.normals.size(), mesh.uvs[0].size(), mesh.uvs[1].size(), mesh.tangents.size(),
                            mesh.colors.size()}) {
    if (size != 0 && size != count) return "an attribute of another length than positions";
  }
  for (const Vec3& p : mesh.positions) {
    if (!IsFinite(p)) return "a position that is not finite";
  }
  for (const Vec3& n : mesh.normals) {
    if (!IsUnit(n)) return "a normal that is not of unit length";
  }
  for (const Vec4& t : mesh.tangents) {
    if (!IsUnit({t.x, t.y, t.z}) || std::fabs(t.w) != 1) return "a tangent that is not of unit length";
  }
  if (!IsIndexOrNone(mesh.material, scene.materials.size())) return "a material index out of range";
  return "";
}

std::string MaterialFlaw(const Material& m, const Scene& scene) {
  for (const TextureUse& use : TexturesOf(m)) {
    const TextureRef& ref = *use.ref;
    if (!IsIndexOrNone(ref.texture, scene.textures.size())) return "a texture index out of range";
    if (ref.uv_set != 0 && ref.uv_set != 1) return "a UV set out of range";
    if (!std::isfinite(ref.offset.x) || !std::isfinite(ref.row_u.x) || !std::isfinite(ref.row_v.y)) {
      return "a texture transform that is not finite";
    }
  }
  const bool finite = IsFinite(m.base.color) && IsFinite(m.emission.radiance) && IsFinite(m.specular.color) &&
                      IsFinite(m.sheen.color) && IsFinite(m.volume.attenuation_color);
  return finite ? "" : "a material colour that is not finite";
}

std::string LightFlaw(const PunctualLight& light) {
  if (!IsFinite(light.color) || !std::isfinite(light.intensity) || light.intensity < 0) {
    return "a light of impossible intensity";
  }
  if (!IsFinite(light.world_from_light)) return "a light that is nowhere";
  const bool has_cone = light.inner_cone_angle < light.outer_cone_angle;
  return light.kind != PunctualLight::Kind::kSpot || has_cone ? "" : "a spot light without a cone";
}

}  // namespace

std::string FirstFlaw(const Scene& scene) {
  std::string flaw;
  for (size_t i = 0; i < scene.meshes.size() && flaw.empty(); ++i) flaw = MeshFlaw(scene.meshes[i], scene);
  for (size_t i = 0; i < scene.materials.size() && flaw.empty(); ++i) {
    flaw = MaterialFlaw(scene.materials[i], scene);
  }
  for (size_t i = 0; i < scene.lights.size() && flaw.empty(); ++i) flaw = LightFlaw(scene.lights[i]);
  if (!flaw.empty()) return flaw;
  for (const Instance& instance : scene.instances) {
    if (!IsIndex(instance.mesh, scene.meshes.size())) return "a mesh index out of range";
    if (!std::isnormal(instance.world_from_object.Determinant())) return "a flat instance";
  }
  for (const Texture& texture : scene.textures) {
    if (!IsIndex(texture.image, scene.images.size())) return "an image index out of range";
  }
  for (const SharedImage& image : scene.images) {
    const size_t bytes = static_cast<size_t>(image->width) * static_cast<size_t>(image->height) * 4;
    if (image->bytes() != (image->is_deep() ? 2 * bytes : bytes))
      return "an image of another size than it says";
  }
  for (const Camera& camera : scene.cameras) {
    if (!(std::fabs(camera.world_from_camera.Determinant() - 1) < 1e-3f)) return "a distorted camera";
  }
  return "";
}

}  // namespace lumifold::scene
