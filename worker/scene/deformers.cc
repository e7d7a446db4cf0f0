#include "worker/scene/deformers.h"

#include <array>
#include <cmath>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "worker/scene/accessors.h"

namespace lumifold::scene {
namespace {

constexpr int kInfluenceSets = 2;  // of four joints each

/// Adds `weight` times the target's `attribute` to `values`, vectors with components x, y and z.
template <typename Vec>
absl::Status AddTarget(const Document& document, const std::map<std::string, int>& target,
                       const char* attribute, float weight, std::vector<Vec>* values) {
  const auto accessor = target.find(attribute);
  if (accessor == target.end() || values->empty()) return absl::OkStatus();
  const auto count = ElementCount(document, accessor->second);
  if (!count.ok()) return WithContext(count.status(), attribute);
  if (*count != values->size()) {
    return absl::InvalidArgumentError(
        absl::StrCat(attribute, ": ", *count, " elements for ", values->size(), " vertices"));
  }
  const auto deltas = ReadVec3s(document, accessor->second);
  if (!deltas.ok()) return WithContext(deltas.status(), attribute);
  for (size_t i = 0; i < values->size(); ++i) {
    Vec& value = (*values)[i];
    const Vec3 delta = (*deltas)[i] * weight;
    value.x += delta.x;
    value.y += delta.y;
    value.z += delta.z;
  }
  return absl::OkStatus();
}

/// Joints and weights of each vertex.
struct Influences {
  std::vector<std::array<uint32_t, 4>> joints;
  std::vector<Vec4> weights;
};

absl::StatusOr<Influences> ReadInfluences(const VertexSource& source, int set, size_t joint_count) {
  const std::string joints = absl::StrCat("JOINTS_", set), weights = absl::StrCat("WEIGHTS_", set);
  Influences influences;
  if (source.Has(joints) != source.Has(weights)) {
    return absl::InvalidArgumentError(absl::StrCat("only one of ", joints, " and ", weights));
  }
  if (auto s = source.Read(joints.c_str(), &influences.joints); !s.ok()) return s;
  if (auto s = source.Read(weights.c_str(), &influences.weights); !s.ok()) return s;
  for (size_t i = 0; i < influences.joints.size(); ++i) {
    for (const uint32_t joint : influences.joints[i]) {
      if (joint >= joint_count) {
        return absl::InvalidArgumentError(absl::StrCat(joints, ": joint ", joint, " of vertex ", i,
                                                       " does not exist (the skin has ", joint_count, ")"));
      }
    }
  }
  return influences;
}

void AddScaled(const Affine& map, float weight, Affine* sum) {
  sum->x += map.x * weight;
  sum->y += map.y * weight;
  sum->z += map.z * weight;
  sum->origin += map.origin * weight;
}

/// The weighted mean of the transforms of vertex `i`; false if it has no weights.
bool MeanMap(std::span<const Influences> sets, size_t i, std::span<const Affine> maps, Affine* mean) {
  constexpr Vec3 kZero = {0, 0, 0};
  float total = 0;
  Affine sum = {kZero, kZero, kZero, kZero};
  for (const Influences& set : sets) {
    if (set.joints.empty()) continue;
    const Vec4& w = set.weights[i];
    const std::array<float, 4> weights = {w.x, w.y, w.z, w.w};
    for (size_t j = 0; j < weights.size(); ++j) {
      if (!(weights[j] > 0)) continue;
      AddScaled(maps[set.joints[i][j]], weights[j], &sum);
      total += weights[j];
    }
  }
  if (!(total > 0)) return false;
  // Stored weights are rounded; without normalisation a vertex far from the origin would be displaced.
  const float share = 1.0f / total;
  *mean = {sum.x * share, sum.y * share, sum.z * share, sum.origin * share};
  return true;
}

void MoveVertex(const Affine& map, size_t i, Mesh* mesh) {
  mesh->positions[i] = map.Point(mesh->positions[i]);
  if (!mesh->normals.empty()) mesh->normals[i] = map.Normal(mesh->normals[i]);
  if (!mesh->tangents.empty()) {
    Vec4& tangent = mesh->tangents[i];
    const Vec3 moved = map.Vector({tangent.x, tangent.y, tangent.z});
    tangent = {moved.x, moved.y, moved.z, tangent.w};
  }
}

}  // namespace

absl::Status ApplyMorphTargets(const Document& document, const tinygltf::Primitive& primitive,
                               std::span<const double> weights, GeometryBudget* budget, Mesh* mesh) {
  if (weights.empty() || primitive.targets.empty()) return absl::OkStatus();
  if (weights.size() != primitive.targets.size()) {
    return absl::InvalidArgumentError(
        absl::StrCat(weights.size(), " weights for ", primitive.targets.size(), " morph targets"));
  }
  for (size_t t = 0; t < weights.size(); ++t) {
    const auto weight = static_cast<float>(weights[t]);
    if (weight == 0) continue;
    const auto vertices = static_cast<int64_t>(mesh->positions.size());
    if (vertices > budget->vertices) {
      return absl::ResourceExhaustedError("more vertices of morph targets than the limit allows");
    }
    budget->vertices -= vertices;
    const auto& target = primitive.targets[t];
    auto s = AddTarget(document, target, "POSITION", weight, &mesh->positions);
    if (s.ok()) s = AddTarget(document, target, "NORMAL", weight, &mesh->normals);
    if (s.ok()) s = AddTarget(document, target, "TANGENT", weight, &mesh->tangents);
    if (!s.ok()) return WithContext(s, absl::StrCat("morph target ", t));
  }
  return absl::OkStatus();
}

absl::StatusOr<int64_t> ApplySkin(const VertexSource& source, std::span<const Affine> world_from_bind,
                                  Mesh* mesh) {
  if (!source.Has("JOINTS_0")) return absl::InvalidArgumentError("is skinned, but has no JOINTS_0");
  std::array<Influences, kInfluenceSets> sets;
  for (int set = 0; set < kInfluenceSets; ++set) {
    auto influences = ReadInfluences(source, set, world_from_bind.size());
    if (!influences.ok()) return influences.status();
    sets[static_cast<size_t>(set)] = *std::move(influences);
  }
  int64_t unmoved = 0;
  for (size_t i = 0; i < mesh->positions.size(); ++i) {
    Affine map;
    if (MeanMap(sets, i, world_from_bind, &map)) {
      MoveVertex(map, i, mesh);
    } else {
      ++unmoved;
    }
  }
  return unmoved;
}

absl::Status CheckDeformed(const Mesh& mesh) {
  const auto is_finite = [](float x, float y, float z) {
    return std::isfinite(x) && std::isfinite(y) && std::isfinite(z);
  };
  for (size_t i = 0; i < mesh.positions.size(); ++i) {
    const Vec3& p = mesh.positions[i];
    bool finite = is_finite(p.x, p.y, p.z);
    if (!mesh.normals.empty()) {
      finite = finite && is_finite(mesh.normals[i].x, mesh.normals[i].y, mesh.normals[i].z);
    }
    if (!mesh.tangents.empty()) {
      finite = finite && is_finite(mesh.tangents[i].x, mesh.tangents[i].y, mesh.tangents[i].z);
    }
    if (!finite) {
      return absl::InvalidArgumentError(
          absl::StrCat("vertex ", i, " is thrown out of floating-point range by morph targets or its skin"));
    }
  }
  return absl::OkStatus();
}

}  // namespace lumifold::scene
