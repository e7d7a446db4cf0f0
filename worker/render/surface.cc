#include "worker/render/surface.h"

#include <algorithm>
#include <cmath>

#include "worker/render/lights.h"

namespace lumifold::render {
namespace {

using scene::Affine;
using scene::Mesh;
using scene::Vec4;

template <typename T>
T Interpolate(const std::vector<T>& values, const uint32_t* corners, float u, float v) {
  return values[corners[0]] * (1.0f - u - v) + values[corners[1]] * u + values[corners[2]] * v;
}

/// The same for values of which the first three components count.
Vec3 Interpolate(const std::vector<Vec4>& values, const uint32_t* corners, float u, float v) {
  const auto xyz = [&](int corner) {
    const Vec4& value = values[corners[corner]];
    return Vec3{value.x, value.y, value.z};
  };
  return xyz(0) * (1.0f - u - v) + xyz(1) * u + xyz(2) * v;
}

/// Bends a shading normal that points away from the viewer until it just faces him: interpolated and mapped
/// normals may do so at silhouettes, where nothing sensible is left to reflect.
Vec3 FaceViewer(Vec3 normal, Vec3 wo) {
  constexpr float kLeastCosine = 0.01f;
  const float cosine = Dot(normal, wo);
  return cosine >= kLeastCosine ? normal : Normalize(normal + wo * (kLeastCosine - cosine));
}

}  // namespace

SurfaceReader::SurfaceReader(const scene::Scene& scene, const TextureSampler& textures)
    : scene_(&scene), textures_(&textures) {
  const scene::Bounds bounds = WorldBounds(scene);
  epsilon_ = bounds.IsEmpty() ? 0.0f : Length(bounds.max - bounds.min) * 0x1p-21f;
}

Surface SurfaceReader::Read(const Hit& hit, const Ray& ray) const {
  const scene::Instance& instance = scene_->instances[hit.instance];
  const Mesh& mesh = scene_->meshes[instance.mesh];
  const Affine& to_world = instance.world_from_object;

  Surface surface;
  surface.material = mesh.material == scene::kNone ? &default_material_ : &scene_->materials[mesh.material];
  surface.position = ray.origin + ray.direction * hit.distance;
  const Vec3 face = Normalize(hit.face_normal);
  surface.front = Dot(face, ray.direction) < 0;
  surface.geometric = surface.front ? face : -face;
  const Vec3 extent = {std::abs(surface.position.x), std::abs(surface.position.y),
                       std::abs(surface.position.z)};
  surface.epsilon = epsilon_ + (MaxComponent(extent) + hit.distance) * 0x1p-20f;
  surface.normal = surface.geometric;
  surface.coat_normal = surface.geometric;
  if (mesh.normals.empty() && mesh.uvs[0].empty() && mesh.uvs[1].empty() && mesh.colors.empty())
    return surface;
  const uint32_t* corners = &mesh.triangles[static_cast<size_t>(hit.triangle) * 3];
  for (int set = 0; set < 2; ++set) {
    if (!mesh.uvs[set].empty()) surface.uv[set] = Interpolate(mesh.uvs[set], corners, hit.u, hit.v);
  }
  if (!mesh.colors.empty()) surface.vertex_color = Interpolate(mesh.colors, corners, hit.u, hit.v);
  if (!mesh.normals.empty()) {
    const Vec3 smooth = to_world.Normal(Interpolate(mesh.normals, corners, hit.u, hit.v));
    if (LengthSquared(smooth) > 0) {
      const Vec3 unit = Normalize(smooth);
      surface.normal = Dot(unit, surface.geometric) < 0 ? -unit : unit;
    }
  }
  surface.coat_normal = surface.normal;
  // The loader has given tangents to every mesh whose normal map has coordinates to be found by.
  if (!mesh.tangents.empty()) MapNormals(mesh, instance, hit, &surface);
  surface.normal = FaceViewer(surface.normal, -ray.direction);
  surface.coat_normal = FaceViewer(surface.coat_normal, -ray.direction);
  return surface;
}

/// The axes of normal maps in the world, unit vectors at right angles.
struct SurfaceReader::TangentFrame {
  Vec3 tangent;
  Vec3 bitangent;
  Vec3 normal;
};

void SurfaceReader::MapNormals(const Mesh& mesh, const scene::Instance& instance, const Hit& hit,
                               Surface* surface) const {
  const scene::Material& material = *surface->material;
  const bool maps_base = material.normal_texture.texture != scene::kNone;
  const bool maps_coat = material.clearcoat_normal_texture.texture != scene::kNone;
  if (!maps_base && !maps_coat) return;
  const uint32_t* corners = &mesh.triangles[static_cast<size_t>(hit.triangle) * 3];
  const Affine& to_world = instance.world_from_object;
  TangentFrame frame;
  frame.normal = surface->normal;
  const Vec3 along = to_world.Vector(Interpolate(mesh.tangents, corners, hit.u, hit.v));
  const Vec3 tangent = along - frame.normal * Dot(along, frame.normal);
  if (LengthSquared(tangent) <= 0) return;
  frame.tangent = Normalize(tangent);
  // From behind, the shading normal was turned round; the texture's own axes belong to the front.
  const float side = surface->front ? 1.0f : -1.0f;
  const float handedness = mesh.tangents[corners[0]].w * (to_world.Determinant() < 0 ? -1.0f : 1.0f);
  frame.bitangent = Cross(frame.normal * side, frame.tangent) * handedness;
  if (maps_base)
    surface->normal = MappedNormal(material.normal_texture, material.normal_scale, frame, *surface);
  if (maps_coat) {
    surface->coat_normal =
        MappedNormal(material.clearcoat_normal_texture, material.clearcoat_normal_scale, frame, *surface);
  }
}

Vec3 SurfaceReader::MappedNormal(const scene::TextureRef& map, float scale, const TangentFrame& frame,
                                 const Surface& surface) const {
  const Vec4 texel = textures_->Sample(map, surface.uv, /*srgb=*/false);
  const float x = (texel.x * 2 - 1) * scale;
  const float y = (texel.y * 2 - 1) * scale;
  const float z = texel.z * 2 - 1;
  const Vec3 mapped = frame.tangent * x + frame.bitangent * y + frame.normal * z;
  return LengthSquared(mapped) > 0 ? Normalize(mapped) : frame.normal;
}

Vec3 SurfaceReader::Color(const scene::TextureRef& ref, const Surface& surface) const {
  const Vec4 t = textures_->Sample(ref, surface.uv, /*srgb=*/true);
  return {t.x, t.y, t.z};
}

Vec3 SurfaceReader::BaseColor(const Surface& surface) const {
  const scene::Material& m = *surface.material;
  const Vec3 color = m.base_color * surface.vertex_color;
  return m.base_color_texture.texture == scene::kNone ? color : color * Color(m.base_color_texture, surface);
}

SurfaceMaterial SurfaceReader::Shade(const Surface& surface) const {
  const scene::Material& m = *surface.material;
  SurfaceMaterial out;
  if (m.unlit) {
    out.base_color = {0, 0, 0};
    out.specular = 0;
    return out;
  }
  out.base_color = BaseColor(surface);
  out.metallic = m.metallic;
  out.roughness = m.roughness;
  if (m.metallic_roughness_texture.texture != scene::kNone) {
    const Vec4 t = textures_->Sample(m.metallic_roughness_texture, surface.uv, /*srgb=*/false);
    out.roughness *= t.y;
    out.metallic *= t.z;
  }
  out.ior = m.ior;
  out.specular = m.specular * textures_->Sample(m.specular_texture, surface.uv, /*srgb=*/false).w;
  out.specular_color = m.specular_color * Color(m.specular_color_texture, surface);
  if (m.transmission > 0) {
    out.transmission = m.transmission * textures_->Sample(m.transmission_texture, surface.uv, false).x;
    out.thin = !m.has_volume;
    out.inside = !surface.front;
  }
  if (m.clearcoat > 0 || MaxComponent(m.sheen_color) > 0) ShadeLayers(surface, &out);
  return out;
}

void SurfaceReader::ShadeLayers(const Surface& surface, SurfaceMaterial* out) const {
  const scene::Material& m = *surface.material;
  const auto data = [&](const scene::TextureRef& ref) {
    return textures_->Sample(ref, surface.uv, /*srgb=*/false);
  };
  if (m.clearcoat > 0) {
    out->clearcoat = m.clearcoat * data(m.clearcoat_texture).x;
    out->clearcoat_roughness = m.clearcoat_roughness * data(m.clearcoat_roughness_texture).y;
    out->coat_normal = surface.coat_normal;
  }
  out->sheen_color = m.sheen_color * Color(m.sheen_color_texture, surface);
  out->sheen_roughness = m.sheen_roughness * data(m.sheen_roughness_texture).w;
}

Vec3 SurfaceReader::Emitted(const Surface& surface) const {
  const scene::Material& m = *surface.material;
  if (m.unlit) return BaseColor(surface);
  if (MaxComponent(m.emission) <= 0 || (!surface.front && !m.double_sided)) return {0, 0, 0};
  return Emission(m, *textures_, surface.uv);
}

}  // namespace lumifold::render
