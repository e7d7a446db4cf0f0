#include "worker/plan/scene_facts.h"

#include <array>
#include <cmath>
#include <vector>

#include "absl/strings/str_cat.h"
#include "worker/render/materials/opacity.h"
#include "worker/scene/diagnostics.h"

namespace lumifold::plan {
namespace {

using scene::Material;
using scene::Vec3;

struct Point {
  double x, y, z;
};

Point operator-(const Point& a, const Point& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
double Dot(const Point& a, const Point& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
Point Cross(const Point& a, const Point& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

/// Whether all points of some triangles lie in one plane, up to `tolerance` metres.
class PlaneTest {
 public:
  explicit PlaneTest(double tolerance) : tolerance_(tolerance) {}

  void Add(const scene::Mesh& mesh, const scene::Affine& world_from_object) {
    for (size_t t = 0; holds_ && t + 2 < mesh.triangles.size(); t += 3) {
      std::array<Point, 3> corners;
      for (size_t c = 0; c < 3; ++c) {
        const Vec3 p = world_from_object.Point(mesh.positions[mesh.triangles[t + c]]);
        corners[c] = {static_cast<double>(p.x), static_cast<double>(p.y), static_cast<double>(p.z)};
      }
      AddTriangle(corners);
    }
  }

  bool holds() const { return holds_; }

 private:
  void AddTriangle(const std::array<Point, 3>& corners) {
    if (!has_plane_) {
      const Point normal = Cross(corners[1] - corners[0], corners[2] - corners[0]);
      const double length = std::sqrt(Dot(normal, normal));
      // A sliver does not tell its plane: it counts as out of plane, which leaves nothing out.
      holds_ = length > tolerance_ * tolerance_;
      if (!holds_) return;
      has_plane_ = true;
      origin_ = corners[0];
      normal_ = {normal.x / length, normal.y / length, normal.z / length};
    }
    for (const Point& corner : corners) holds_ &= std::abs(Dot(corner - origin_, normal_)) <= tolerance_;
  }

  double tolerance_;
  bool holds_ = true;
  bool has_plane_ = false;
  Point origin_ = {0, 0, 0};
  Point normal_ = {0, 0, 1};
};

/// Rounding of float positions relative to the scene's size, with a margin.
double PlaneTolerance(const scene::Scene& scene) {
  const scene::Bounds bounds = scene::WorldBounds(scene);
  return bounds.IsEmpty() ? 0.0 : static_cast<double>(Length(bounds.max - bounds.min)) * 0x1p-20;
}

/// Names come from the file: one line, and not too long.
std::string NameOf(const Material& material) {
  constexpr size_t kMaxBytes = 64;
  if (material.name.empty()) return "a material without a name";
  return absl::StrCat("material '", scene::OneLine(material.name.substr(0, kMaxBytes)), "'");
}

void AddMaterial(const Material& material, render::TextureRanges* ranges, SceneFacts* facts) {
  const render::LobeSet lobes = render::LobesOf(material, ranges);
  facts->lobes |= lobes;
  if ((lobes.glossy || lobes.delta) && facts->glossy_material.empty())
    facts->glossy_material = NameOf(material);
  if (lobes.delta && facts->delta_material.empty()) facts->delta_material = NameOf(material);
  facts->emitters |= material.unlit || MaxComponent(material.emission.radiance) > 0;
}

/// Materials of the frame's surfaces, or of the whole file if the scene is animated.
void AddMaterials(const scene::Scene& scene, render::TextureRanges* ranges, SceneFacts* facts) {
  if (facts->animated) {
    for (const Material& material : scene.materials) AddMaterial(material, ranges, facts);
    AddMaterial(Material(), ranges, facts);  // a hidden mesh may have glTF's default material
    return;
  }
  std::vector<bool> is_known(scene.meshes.size());
  for (const scene::Instance& instance : scene.instances) {
    const scene::Mesh& mesh = scene.meshes[instance.mesh];
    if (is_known[instance.mesh] || mesh.triangles.empty()) continue;
    is_known[instance.mesh] = true;
    AddMaterial(render::MaterialOf(scene, mesh), ranges, facts);
  }
}

}  // namespace

SceneFacts FactsOf(const scene::Scene& scene, bool has_environment) {
  SceneFacts facts;
  facts.animated = scene.animated;
  facts.environment = has_environment;
  facts.punctual = scene.animated || !scene.lights.empty();  // a light that a transform hides may appear
  render::TextureRanges ranges(scene);
  AddMaterials(scene, &ranges, &facts);
  PlaneTest all(PlaneTolerance(scene));
  PlaneTest delta = all;
  for (const scene::Instance& instance : scene.instances) {
    const scene::Mesh& mesh = scene.meshes[instance.mesh];
    if (mesh.triangles.empty()) continue;
    ++facts.surfaces;
    all.Add(mesh, instance.world_from_object);
    if (render::LobesOf(render::MaterialOf(scene, mesh), &ranges).delta)
      delta.Add(mesh, instance.world_from_object);
    if (render::OpacityClassOf(scene, mesh) == render::OpacityClass::kOpaque) continue;
    ++facts.alpha_surfaces;
    if (render::ScannedOpacityClassOf(scene, mesh, &ranges) == render::OpacityClass::kOpaque)
      ++facts.opaque_surfaces;
  }
  facts.in_one_plane = !facts.animated && all.holds();
  facts.delta_in_one_plane = !facts.animated && delta.holds();
  return facts;
}

}  // namespace lumifold::plan
