#include "worker/render/tracing/surface.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace lumifold::render {
namespace {

using scene::Affine;
using scene::Mesh;
using scene::Vec4;

template <typename T>
T Interpolate(const std::vector<T>& values, const uint32_t* corners, float u, float v) {
  return values[corners[0]] * (1.0f - u - v) + values[corners[1]] * u + values[corners[2]] * v;
}

/// The same for the first three components.
Vec3 Interpolate(const std::vector<Vec4>& values, const uint32_t* corners, float u, float v) {
  const auto xyz = [&](int corner) {
    const Vec4& value = values[corners[corner]];
    return Vec3{value.x, value.y, value.z};
  };
  return xyz(0) * (1.0f - u - v) + xyz(1) * u + xyz(2) * v;
}

/// Rotates a shading normal that points away from the viewer until it just faces the viewer. Interpolated and
/// mapped normals may point away at silhouettes, where they would give no meaningful reflection.
Vec3 FaceViewer(Vec3 normal, Vec3 wo) {
  constexpr float kMinCosine = 0.01f;
  const float cosine = Dot(normal, wo);
  return cosine >= kMinCosine ? normal : Normalize(normal + wo * (kMinCosine - cosine));
}

bool HasTextures(const scene::Material& material) {
  const auto refs = scene::TexturesOf(material);
  return std::any_of(refs.begin(), refs.end(),
                     [](const scene::TextureUse& use) { return use.ref->texture != scene::kNone; });
}

SurfaceReader::Kind KindOfMaterial(const scene::Material& m) {
  using Kind = SurfaceReader::Kind;
  if (m.transmission.factor > 0 || m.clearcoat.factor > 0 || MaxComponent(m.sheen.color) > 0 ||
      m.base.anisotropy.strength > 0 || m.base.diffuse_transmission.factor > 0 || m.iridescence.factor > 0)
    return Kind::kRare;
  return m.base.metallic > 0 || m.specular.factor > 0 ? Kind::kBase : Kind::kDiffuse;
}

/// Whether all vertex normals equal the face normals, or there are none.
bool IsFlat(const Mesh& mesh) {
  constexpr float kMinCosine = 1.0f - 0x1p-20f;
  if (mesh.normals.empty()) return true;
  for (size_t t = 0; t + 2 < mesh.triangles.size(); t += 3) {
    const uint32_t* corners = &mesh.triangles[t];
    const Vec3 origin = mesh.positions[corners[0]];
    const Vec3 area = Cross(mesh.positions[corners[1]] - origin, mesh.positions[corners[2]] - origin);
    const float least = kMinCosine * Length(area);
    for (int c = 0; c < 3; ++c) {
      if (std::abs(Dot(mesh.normals[corners[c]], area)) < least) return false;
    }
  }
  return true;
}

}  // namespace

void Surface::SpawnRay(const BsdfSample& step, uint64_t random_key, Ray* ray) const {
  ray->origin = Offset(step.wi);
  ray->direction = step.wi;
  ray->max_distance = std::numeric_limits<float>::infinity();
  ray->random_key = random_key;
  ray->width = cone_width;
  ray->spread = 0;
  if (cone_width <= 0) return;
  ray->spread = step.pdf > 0 ? std::max(cone_spread, kConeShareOfDensity / std::sqrt(step.pdf)) : cone_spread;
}

SurfaceReader::SurfaceReader(const scene::Scene& scene, const TextureSampler& textures)
    : textures_(&textures) {
  const scene::Bounds bounds = WorldBounds(scene);
  epsilon_ = bounds.IsEmpty() ? 0.0f : Length(bounds.max - bounds.min) * 0x1p-21f;
  uniform_.resize(scene.meshes.size());
  std::vector<InstanceData> of_mesh;
  for (size_t i = 0; i < scene.meshes.size(); ++i) of_mesh.push_back(DataOf(scene, i));
  for (const scene::Instance& instance : scene.instances) {
    InstanceData& data = instances_.emplace_back(of_mesh[instance.mesh]);
    data.to_world = &instance.world_from_object;
    any_textures_ |= data.is_textured;
  }
}

SurfaceReader::InstanceData SurfaceReader::DataOf(const scene::Scene& scene, size_t mesh_index) {
  const Mesh& mesh = scene.meshes[mesh_index];
  InstanceData data;
  data.mesh = &mesh;
  data.material = mesh.material == scene::kNone ? &default_material_ : &scene.materials[mesh.material];
  data.is_textured = HasTextures(*data.material);
  data.is_emissive = data.material->unlit || MaxComponent(data.material->emission.radiance) > 0;
  data.kind = KindOfMaterial(*data.material);
  const bool is_uniform = !data.is_textured && mesh.colors.empty();
  const bool has_tangents = data.material->base.anisotropy.strength > 0;
  data.is_plain = is_uniform && !has_tangents && IsFlat(mesh);
  // The values of glass and coats depend on the side and the normal, those of anisotropic layers on tangents.
  if (is_uniform && !has_tangents && data.material->transmission.factor <= 0 &&
      data.material->clearcoat.factor <= 0) {
    Surface anywhere;
    anywhere.material = data.material;
    uniform_[mesh_index] = Shade(anywhere);
    data.values = &uniform_[mesh_index];
  }
  return data;
}

void SurfaceReader::Read(const Hit& hit, const Ray& ray, Surface* surface) const {
  const InstanceData& instance = instances_[hit.instance];
  surface->material = instance.material;
  surface->values = instance.values;
  surface->is_emissive = instance.is_emissive;
  surface->is_base = instance.kind != Kind::kRare;
  surface->position = ray.origin + ray.direction * hit.distance;
  const Vec3 face = Normalize(hit.face_normal);
  surface->front = Dot(face, ray.direction) < 0;
  surface->geometric = surface->front ? face : -face;
  const Vec3 extent = {std::abs(surface->position.x), std::abs(surface->position.y),
                       std::abs(surface->position.z)};
  surface->epsilon = epsilon_ + (MaxComponent(extent) + hit.distance) * 0x1p-20f;
  surface->cone_width = any_textures_ ? ray.WidthAt(hit.distance) : 0.0f;
  surface->cone_spread = any_textures_ ? ray.spread : 0.0f;
  surface->normal = surface->geometric;
  surface->vertex_color = {1, 1, 1};
  if (surface->material->clearcoat.factor > 0) surface->coat_normal = surface->geometric;
  if (!instance.is_plain) ReadCorners(instance, hit, ray, surface);
}

/// Interpolates the vertex attributes: texture coordinates, colour and shading normals.
void SurfaceReader::ReadCorners(const InstanceData& instance, const Hit& hit, const Ray& ray,
                                Surface* surface) const {
  const Mesh& mesh = *instance.mesh;
  const Affine& to_world = *instance.to_world;
  const uint32_t* corners = &mesh.triangles[static_cast<size_t>(hit.triangle) * 3];
  for (int set = 0; set < 2; ++set)
    surface->uv[set] = mesh.uvs[set].empty() ? Vec2{} : Interpolate(mesh.uvs[set], corners, hit.u, hit.v);
  if (instance.is_textured) surface->footprint = {};
  if (instance.is_textured && surface->cone_width > 0)
    surface->footprint = FootprintAt(mesh, to_world, hit, ray, surface->geometric);
  if (!mesh.colors.empty()) surface->vertex_color = Interpolate(mesh.colors, corners, hit.u, hit.v);
  if (!mesh.normals.empty()) {
    const Vec3 smooth = to_world.Normal(Interpolate(mesh.normals, corners, hit.u, hit.v));
    if (LengthSquared(smooth) > 0) {
      const Vec3 unit = Normalize(smooth);
      surface->normal = Dot(unit, surface->geometric) < 0 ? -unit : unit;
    }
  }
  const Vec3 unmapped = surface->normal;
  const scene::Material& material = *surface->material;
  // The loader creates tangents for every mesh that has the texture coordinates of its normal map.
  if (material.normal_map.texture.texture != scene::kNone) {
    surface->normal = MappedNormal(material.normal_map.texture, material.normal_map.scale, instance, hit,
                                   *surface, unmapped);
  }
  if (material.base.anisotropy.strength > 0) {
    const auto axes = TangentsAt(instance, hit, surface->front, unmapped);
    surface->anisotropy = axes.has_value() ? AnisotropyAt(*axes, *surface) : Vec3{0, 0, 0};
  }
  surface->normal = FaceViewer(surface->normal, -ray.direction);
  if (material.clearcoat.factor > 0)
    surface->coat_normal = CoatNormal(instance, hit, *surface, unmapped, ray);
}

Vec3 SurfaceReader::CoatNormal(const InstanceData& instance, const Hit& hit, const Surface& surface,
                               Vec3 unmapped, const Ray& ray) const {
  const scene::Material& material = *surface.material;
  const bool is_mapped = material.clearcoat.normal_map.texture.texture != scene::kNone;
  const Vec3 normal =
      is_mapped ? MappedNormal(material.clearcoat.normal_map.texture, material.clearcoat.normal_map.scale,
                               instance, hit, surface, unmapped)
                : unmapped;
  return FaceViewer(normal, -ray.direction);
}

/// The cone intersects the face in an ellipse. Its longer diameter lies along the ray's projection on the
/// face.
Footprint SurfaceReader::FootprintAt(const Mesh& mesh, const Affine& to_world, const Hit& hit, const Ray& ray,
                                     Vec3 normal) const {
  constexpr float kMinCosine = 0.01f;
  const uint32_t* corners = &mesh.triangles[static_cast<size_t>(hit.triangle) * 3];
  const Vec3 edge1 = to_world.Vector(mesh.positions[corners[1]] - mesh.positions[corners[0]]);
  const Vec3 edge2 = to_world.Vector(mesh.positions[corners[2]] - mesh.positions[corners[0]]);
  const Vec3 area = Cross(edge1, edge2);
  const float area2 = LengthSquared(area);
  const float cosine = Dot(ray.direction, normal);
  const Vec3 projected = ray.direction - normal * cosine;
  const float sine = Length(projected);
  const Vec3 along = sine > 1e-3f ? projected / sine : Frame::Of(normal).x;
  const float width = ray.WidthAt(hit.distance);
  const Vec3 diameters[2] = {along * (width / std::max(std::abs(cosine), kMinCosine)),
                             Cross(normal, along) * width};
  Footprint footprint;
  if (area2 <= 0) return footprint;
  for (int d = 0; d < 2; ++d) {
    const float du = Dot(Cross(diameters[d], edge2), area) / area2;
    const float dv = Dot(Cross(edge1, diameters[d]), area) / area2;
    for (int set = 0; set < 2; ++set) {
      const std::vector<Vec2>& uvs = mesh.uvs[set];
      if (uvs.empty()) continue;
      const Vec2 origin = uvs[corners[0]];
      footprint.diameter[set][d] = (uvs[corners[1]] - origin) * du + (uvs[corners[2]] - origin) * dv;
    }
  }
  return footprint;
}

std::optional<SurfaceReader::Tangents> SurfaceReader::TangentsAt(const InstanceData& instance, const Hit& hit,
                                                                 bool front, Vec3 normal) {
  const Mesh& mesh = *instance.mesh;
  if (mesh.tangents.empty()) return std::nullopt;
  const Affine& to_world = *instance.to_world;
  const uint32_t* corners = &mesh.triangles[static_cast<size_t>(hit.triangle) * 3];
  const Vec3 along = to_world.Vector(Interpolate(mesh.tangents, corners, hit.u, hit.v));
  Vec3 tangent = along - normal * Dot(along, normal);
  if (LengthSquared(tangent) <= 0) return std::nullopt;
  tangent = Normalize(tangent);
  // From behind, the shading normal was turned round; the texture's own axes belong to the front.
  const float side = front ? 1.0f : -1.0f;
  const float handedness = mesh.tangents[corners[0]].w * (to_world.Determinant() < 0 ? -1.0f : 1.0f);
  return Tangents{tangent, Cross(normal * side, tangent) * handedness};
}

Vec3 SurfaceReader::AnisotropyAt(const Tangents& axes, const Surface& surface) const {
  const scene::Material::Base::Anisotropy& anisotropy = surface.material->base.anisotropy;
  Vec2 direction = anisotropy.direction;
  float strength = anisotropy.strength;
  if (anisotropy.texture.texture != scene::kNone) {
    const Vec4 texel = Data(anisotropy.texture, surface);
    const Vec2 turned = {texel.x * 2 - 1, texel.y * 2 - 1};
    const float length = std::sqrt(turned.x * turned.x + turned.y * turned.y);
    if (length <= 0) return {0, 0, 0};
    direction = {(direction.x * turned.x - direction.y * turned.y) / length,
                 (direction.y * turned.x + direction.x * turned.y) / length};
    strength *= texel.z;
  }
  return (axes.tangent * direction.x + axes.bitangent * direction.y) * strength;
}

Vec3 SurfaceReader::MappedNormal(const scene::TextureRef& map, float scale, const InstanceData& instance,
                                 const Hit& hit, const Surface& surface, Vec3 normal) const {
  const auto axes = TangentsAt(instance, hit, surface.front, normal);
  if (!axes.has_value()) return normal;
  const Vec4 texel = Data(map, surface);
  const float x = (texel.x * 2 - 1) * scale;
  const float y = (texel.y * 2 - 1) * scale;
  const float z = texel.z * 2 - 1;
  const Vec3 mapped = axes->tangent * x + axes->bitangent * y + normal * z;
  return LengthSquared(mapped) > 0 ? Normalize(mapped) : normal;
}

Vec3 SurfaceReader::Color(const scene::TextureRef& ref, const Surface& surface) const {
  const Vec4 t = textures_->Sample(ref, surface.uv, surface.footprint, /*srgb=*/true);
  return {t.x, t.y, t.z};
}

Vec4 SurfaceReader::Data(const scene::TextureRef& ref, const Surface& surface) const {
  return textures_->Sample(ref, surface.uv, surface.footprint, /*srgb=*/false);
}

Vec3 SurfaceReader::BaseColor(const Surface& surface) const {
  const scene::Material& m = *surface.material;
  const Vec3 color = m.base.color * surface.vertex_color;
  return m.base.color_texture.texture == scene::kNone ? color : color * Color(m.base.color_texture, surface);
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
  out.metallic = m.base.metallic;
  out.roughness = m.base.roughness;
  if (m.base.metallic_roughness_texture.texture != scene::kNone) {
    const Vec4 t = Data(m.base.metallic_roughness_texture, surface);
    out.roughness *= t.y;
    out.metallic *= t.z;
  }
  if (m.base.anisotropy.strength > 0) out.rare.anisotropy = surface.anisotropy;
  out.ior = m.ior;
  out.specular = m.specular.factor * Data(m.specular.factor_texture, surface).w;
  out.specular_color = m.specular.color * Color(m.specular.color_texture, surface);
  if (m.transmission.factor > 0) {
    out.transmission = m.transmission.factor * Data(m.transmission.texture, surface).x;
    out.thin = !m.volume.is_solid;
    out.inside = !surface.front;
    out.rare.dispersion = m.volume.dispersion;
  }
  if (m.base.diffuse_transmission.factor > 0) {
    out.rare.diffuse_transmission =
        m.base.diffuse_transmission.factor * Data(m.base.diffuse_transmission.factor_texture, surface).w;
    out.rare.diffuse_transmission_color =
        m.base.diffuse_transmission.color * Color(m.base.diffuse_transmission.color_texture, surface);
  }
  if (m.iridescence.factor > 0) ShadeFilm(surface, &out);
  if (m.clearcoat.factor > 0 || MaxComponent(m.sheen.color) > 0) ShadeLayers(surface, &out);
  return out;
}

void SurfaceReader::ShadeLayers(const Surface& surface, SurfaceMaterial* out) const {
  const scene::Material& m = *surface.material;
  if (m.clearcoat.factor > 0) {
    out->clearcoat = m.clearcoat.factor * Data(m.clearcoat.factor_texture, surface).x;
    out->clearcoat_roughness = m.clearcoat.roughness * Data(m.clearcoat.roughness_texture, surface).y;
    out->coat_normal = surface.coat_normal;
  }
  out->sheen_color = m.sheen.color * Color(m.sheen.color_texture, surface);
  out->sheen_roughness = m.sheen.roughness * Data(m.sheen.roughness_texture, surface).w;
}

void SurfaceReader::ShadeFilm(const Surface& surface, SurfaceMaterial* out) const {
  const scene::Material::Iridescence& film = surface.material->iridescence;
  out->rare.film_ior = film.ior;
  out->rare.film_thickness_nm = film.min_thickness_nm + (film.max_thickness_nm - film.min_thickness_nm) *
                                                            Data(film.thickness_texture, surface).y;
  if (out->rare.film_thickness_nm > 0)
    out->rare.iridescence = film.factor * Data(film.factor_texture, surface).x;
}

Vec3 SurfaceReader::EmittedBy(const Surface& surface) const {
  const scene::Material& m = *surface.material;
  if (m.unlit) return BaseColor(surface);
  if (!surface.front && !m.double_sided) return {0, 0, 0};
  return m.emission.radiance * Color(m.emission.texture, surface);
}

}  // namespace lumifold::render
