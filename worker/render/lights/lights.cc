#include "worker/render/lights/lights.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "filter/image/color.h"
#include "filter/image/portable_math.h"
#include "worker/render/materials/opacity.h"

namespace lumifold::render {
namespace {

using scene::Material;
using scene::Vec2;
using scene::Vec3;

/// Finite and infinite lights each get at least this fraction of the samples.
constexpr double kMinShare = 0.25;
/// Shares are whole eighths: of any eight samples of a pixel, whose numbers are stratified, each kind gets
/// the same count, so that which kind it was adds no noise where one of them is hidden.
constexpr double kShares = 8;

bool IsEmissive(const Material& material) {
  return !material.unlit && MaxComponent(material.emission.radiance) > 0;
}

Vec2 Interpolate(const Vec2 corners[3], float b1, float b2) {
  return corners[0] * (1.0f - b1 - b2) + corners[1] * b1 + corners[2] * b2;
}

/// Where along the edges a uniform point is; preserves adjacency. Each half of the square maps to one half of
/// a triangle, or of a parallelogram, whose `fold` is 0. Source: Heitz 2019, "A Low-Distortion Map Between
/// Triangle and Square".
Vec2 LightPoint(Vec2 u, float fold) {
  const float least = fold * std::min(u.x, u.y);
  return {u.x - least, u.y - least};
}

/// Part of a parallelogram's size by which its corner may miss its place.
constexpr float kSameCorner = 0x1p-18f;

/// Makes of two plain triangles the parallelogram that they are. Returns whether they are one.
bool Join(const LightTriangle& other, LightTriangle* light) {
  if (!light->IsPlain() || !other.IsPlain() || light->fold <= 0) return false;
  const Vec3 a[3] = {light->corner, light->corner + light->edge1, light->corner + light->edge2};
  const Vec3 b[3] = {other.corner, other.corner + other.edge1, other.corner + other.edge2};
  const float least2 =
      std::max(LengthSquared(light->edge1), LengthSquared(light->edge2)) * kSameCorner * kSameCorner;
  const auto is_same = [least2](Vec3 p, Vec3 q) { return LengthSquared(p - q) <= least2; };
  for (int i = 0; i < 3; ++i) {
    const Vec3 first = a[(i + 1) % 3];
    const Vec3 second = a[(i + 2) % 3];
    for (int k = 0; k < 3; ++k) {  // the shared edge runs the other way there
      if (!is_same(b[(k + 1) % 3], second) || !is_same(b[(k + 2) % 3], first) ||
          !is_same(b[k] - first, second - a[i]))
        continue;
      light->corner = a[i];
      light->edge1 = first - a[i];
      light->edge2 = second - a[i];
      light->inverse_area *= 0.5f;
      light->fold = 0;
      return true;
    }
  }
  return false;
}

double SumOf(const std::vector<double>& values) {
  double sum = 0;
  for (const double value : values) sum += value;
  return sum;
}

/// A triangle of a mesh in the world.
LightTriangle TriangleOf(const scene::Mesh& mesh, size_t first_index,
                         const scene::Affine& world_from_object) {
  LightTriangle light;
  Vec3 p[3];
  for (int c = 0; c < 3; ++c) {
    const uint32_t vertex = mesh.triangles[first_index + c];
    p[c] = world_from_object.Point(mesh.positions[vertex]);
    for (int set = 0; set < 2; ++set) {
      if (!mesh.uvs[set].empty()) light.uv[set][c] = mesh.uvs[set][vertex];
    }
  }
  light.corner = p[0];
  light.edge1 = p[1] - p[0];
  light.edge2 = p[2] - p[0];
  const Vec3 normal = Cross(light.edge1, light.edge2);
  const float length = Length(normal);
  // A mirroring transform reverses the winding; the front side stays the same.
  const float side = world_from_object.Determinant() < 0 ? -1.0f : 1.0f;
  if (length > 0) {
    light.normal = normal * (side / length);
    light.inverse_area = 2.0f / length;
  }
  return light;
}

/// Half the diagonal of the scene's bounding box.
double SceneRadius(const scene::Scene& scene) {
  const scene::Bounds bounds = WorldBounds(scene);
  return bounds.IsEmpty() ? 1.0 : 0.5 * static_cast<double>(Length(bounds.max - bounds.min));
}

}  // namespace

/// Power of the lights, as luminance.
struct LightSet::Powers {
  double finite = 0;                // of all
  std::vector<double> intensities;  // of each finite one, greatest: triangles, points
  std::vector<double> infinite;     // of each: directional lights, environment
};

LightSet::LightSet(const scene::Scene& scene, const TextureSampler& textures,
                   std::shared_ptr<const Environment> environment)
    : scene_(&scene), textures_(&textures) {
  Powers powers;
  first_of_instance_.assign(scene.instances.size(), -1);
  for (size_t i = 0; i < scene.instances.size(); ++i)
    AddInstance(scene, static_cast<int>(i), textures, &powers);
  const double radius = SceneRadius(scene);
  AddPunctual(scene, radius, &powers);
  AddEnvironment(std::move(environment), radius, &powers);

  std::vector<EmitterBounds> bounds;
  bounds.reserve(powers.intensities.size());
  for (size_t i = 0; i < powers.intensities.size(); ++i)
    bounds.push_back(BoundsOf(static_cast<uint32_t>(i), powers.intensities[i]));
  tree_ = LightTree(bounds);
  infinite_ = AliasTable(powers.infinite);
  const double infinite = SumOf(powers.infinite);
  if (powers.finite > 0) {
    const double share = std::round(kShares * powers.finite / (powers.finite + infinite)) / kShares;
    finite_share_ = infinite > 0 ? static_cast<float>(std::clamp(share, kMinShare, 1 - kMinShare)) : 1.0f;
  }
  if (environment_ != nullptr)
    environment_share_ =
        (1.0f - finite_share_) * infinite_.Probability(static_cast<uint32_t>(directional_.size()));
}

void LightSet::AddInstance(const scene::Scene& scene, int index, const TextureSampler& textures,
                           Powers* powers) {
  const scene::Instance& instance = scene.instances[index];
  const scene::Mesh& mesh = scene.meshes[instance.mesh];
  if (mesh.material == scene::kNone) return;
  const Material& material = scene.materials[mesh.material];
  if (!IsEmissive(material)) return;
  const Vec3 mean = material.emission.radiance * textures.Mean(material.emission.texture, /*srgb=*/true);
  const auto luminance = static_cast<double>(Luminance(mean.x, mean.y, mean.z));
  first_of_instance_[index] = static_cast<int64_t>(emitter_of_.size());
  for (size_t t = 0; t + 2 < mesh.triangles.size(); t += 3) {
    LightTriangle light = TriangleOf(mesh, t, instance.world_from_object);
    light.radiance = material.emission.radiance;
    light.both_sides = material.double_sided ? 1.0f : 0.0f;
    if (material.emission.texture.texture != scene::kNone) light.textured = &material;
    if (material.alpha_mode != scene::AlphaMode::kOpaque) light.alpha_mesh = &mesh;
    light.number = static_cast<uint32_t>(t / 3);
    const double area = light.inverse_area > 0 ? 1 / static_cast<double>(light.inverse_area) : 0.0;
    powers->finite += area * luminance * static_cast<double>(kPi) * (material.double_sided ? 2 : 1);
    if (t > 0 && Join(light, &triangles_.back())) {
      powers->intensities.back() += area * luminance;
    } else {
      triangles_.push_back(light);
      powers->intensities.push_back(area * luminance);
    }
    emitter_of_.push_back(static_cast<uint32_t>(triangles_.size() - 1));
  }
}

void LightSet::AddPunctual(const scene::Scene& scene, double scene_radius, Powers* powers) {
  for (const scene::PunctualLight& light : scene.lights) {
    const PunctualEmitter emitter(light);
    const double power = emitter.Power(scene_radius);
    if (emitter.IsDirectional()) {
      directional_.push_back(emitter);
      powers->infinite.push_back(power);
    } else {
      points_.push_back(emitter);
      powers->finite += power;
      powers->intensities.push_back(emitter.Intensity());
    }
  }
}

void LightSet::AddEnvironment(std::shared_ptr<const Environment> environment, double scene_radius,
                              Powers* powers) {
  if (environment == nullptr) return;
  environment_ = std::move(environment);
  powers->infinite.push_back(environment_->Fluence() * static_cast<double>(kPi) * scene_radius *
                             scene_radius);
}

EmitterBounds LightSet::BoundsOf(uint32_t emitter, double intensity) const {
  EmitterBounds bounds;
  bounds.intensity = intensity;
  const auto include = [&bounds](Vec3 p) {
    bounds.box.min = {std::min(bounds.box.min.x, p.x), std::min(bounds.box.min.y, p.y),
                      std::min(bounds.box.min.z, p.z)};
    bounds.box.max = {std::max(bounds.box.max.x, p.x), std::max(bounds.box.max.y, p.y),
                      std::max(bounds.box.max.z, p.z)};
  };
  if (emitter < triangles_.size()) {
    const LightTriangle& light = triangles_[emitter];
    include(light.corner);
    include(light.corner + light.edge1);
    include(light.corner + light.edge2);
    if (light.fold <= 0) include(light.corner + light.edge1 + light.edge2);
    bounds.axis = light.normal;
    bounds.both_sides = light.both_sides > 0;
    return bounds;
  }
  const PunctualEmitter& light = points_[emitter - triangles_.size()];
  include(light.position());
  bounds.axis = light.axis();
  const bool spot = light.cos_outer() > -1.0f;
  bounds.spread = spot ? Acos(light.cos_outer()) : kPi;
  bounds.falloff = spot ? 0.01f : 0.5f * kPi;  // above 0, so that rounding does not darken the cone's edge
  return bounds;
}

LightSample LightSet::Sample(const LightReceiver& from, float u_light, Vec2 u) const {
  if (u_light >= finite_share_) return SampleInfinite(u_light, u);
  return SampleFinite(PickFinite(from, u_light), from.position, u);
}

LightSample LightSet::SampleFinite(const LightTree::Choice& choice, Vec3 from, Vec2 u) const {
  if (choice.probability <= 0) return {};
  const float probability = finite_share_ * choice.probability;
  if (choice.emitter < triangles_.size())
    return SampleTriangle(triangles_[choice.emitter], probability, from, u);
  return SamplePunctual(points_[choice.emitter - triangles_.size()], probability, from);
}

LightSample LightSet::SampleTriangle(const LightTriangle& light, float probability, Vec3 from, Vec2 u) const {
  const auto [b1, b2] = LightPoint(u, light.fold);
  LightSample sample;
  const Vec3 to_light = light.corner + light.edge1 * b1 + light.edge2 * b2 - from;
  const float distance2 = LengthSquared(to_light);
  if (distance2 <= 0) return sample;
  sample.distance = std::sqrt(distance2);
  sample.direction = to_light * (1.0f / sample.distance);
  const float cosine = -Dot(sample.direction, light.normal);
  if (cosine == 0 || (cosine < 0 && light.both_sides <= 0)) return sample;
  sample.pdf = light.inverse_area * distance2 / std::abs(cosine) * probability;
  sample.radiance = light.radiance;
  if (light.textured != nullptr) {
    const Vec2 uv[2] = {Interpolate(light.uv[0], b1, b2), Interpolate(light.uv[1], b1, b2)};
    const scene::Vec4 t = textures_->Sample(light.textured->emission.texture, uv, /*srgb=*/true);
    sample.radiance *= Vec3{t.x, t.y, t.z};
  }
  // Rays hit a half-transparent light with its opacity as probability; for light samples it is a factor.
  if (light.alpha_mesh != nullptr)
    sample.radiance *= OpacityAt(*scene_, *light.alpha_mesh, light.number, b1, b2);
  return sample;
}

LightSample LightSet::SamplePunctual(const PunctualEmitter& light, float probability, Vec3 from) const {
  LightSample sample;
  sample.is_delta = true;
  const Vec3 to_light = light.position() - from;
  const float distance = Length(to_light);
  if (distance <= 0) return sample;
  sample.distance = distance;
  sample.direction = to_light / distance;
  sample.radiance = light.Irradiance(sample.direction, distance);
  sample.pdf = probability;
  return sample;
}

LightSample LightSet::SampleInfinite(float u_light, Vec2 u) const {
  LightSample sample;
  const uint32_t index = infinite_.Pick((u_light - finite_share_) / (1.0f - finite_share_));
  const float probability = (1.0f - finite_share_) * infinite_.Probability(index);
  if (index < directional_.size()) {
    sample.is_delta = true;
    sample.direction = -directional_[index].axis();
    sample.radiance = directional_[index].Irradiance(sample.direction, 0);
    sample.pdf = probability;
    return sample;
  }
  const EnvironmentSample environment = environment_->Sample(u);
  sample.direction = environment.direction;
  sample.radiance = environment.radiance;
  sample.pdf = probability * environment.pdf;
  return sample;
}

float LightSet::DensityOfHit(const LightReceiver& from, int instance, uint32_t triangle, float distance,
                             float cos_light) const {
  if (first_of_instance_[instance] < 0 || cos_light <= 0 || finite_share_ <= 0) return 0;
  const uint32_t emitter = emitter_of_[static_cast<size_t>(first_of_instance_[instance]) + triangle];
  const float choice = tree_.Probability(from, emitter);
  return finite_share_ * choice * triangles_[emitter].inverse_area * distance * distance / cos_light;
}

}  // namespace lumifold::render
