#include "worker/scene/transforms.h"

#include <cmath>
#include <limits>

#include "absl/strings/str_cat.h"

namespace lumifold::scene {
namespace {

bool IsFinite(Vec3 v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

absl::Status CheckArray(const std::vector<double>& values, size_t size, const char* field) {
  if (values.size() != size) {
    return absl::InvalidArgumentError(absl::StrCat(field, " has ", values.size(), " numbers, not ", size));
  }
  for (const double value : values) {
    if (!std::isfinite(value) || std::fabs(value) > double{std::numeric_limits<float>::max()}) {
      return absl::InvalidArgumentError(absl::StrCat(field, " is not finite"));
    }
  }
  return absl::OkStatus();
}

Vec3 Vec3At(const std::vector<double>& values, size_t at) {
  return {static_cast<float>(values[at]), static_cast<float>(values[at + 1]),
          static_cast<float>(values[at + 2])};
}

absl::StatusOr<Affine> AffineFromMatrix(const std::vector<double>& m) {
  if (auto s = CheckArray(m, 16, "matrix"); !s.ok()) return s;
  // Exporters leave rounding errors in the last row.
  constexpr double kTolerance = 1e-5;
  if (std::fabs(m[3]) > kTolerance || std::fabs(m[7]) > kTolerance || std::fabs(m[11]) > kTolerance ||
      std::fabs(m[15] - 1) > kTolerance) {
    return absl::InvalidArgumentError("matrix has a last row other than 0 0 0 1");
  }
  return Affine{Vec3At(m, 0), Vec3At(m, 4), Vec3At(m, 8), Vec3At(m, 12)};
}

}  // namespace

absl::StatusOr<Affine> AffineFromTrs(Vec3 translation, Vec4 rotation, Vec3 scale) {
  const double x = rotation.x, y = rotation.y, z = rotation.z, w = rotation.w;
  const double norm = x * x + y * y + z * z + w * w;
  if (!(norm > 0) || !std::isfinite(norm)) return absl::InvalidArgumentError("rotation is no quaternion");
  const double s = 2 / norm;
  const auto column = [](double a, double b, double c, float length) {
    return Vec3{static_cast<float>(a), static_cast<float>(b), static_cast<float>(c)} * length;
  };
  return Affine{column(1 - s * (y * y + z * z), s * (x * y + z * w), s * (x * z - y * w), scale.x),
                column(s * (x * y - z * w), 1 - s * (x * x + z * z), s * (y * z + x * w), scale.y),
                column(s * (x * z + y * w), s * (y * z - x * w), 1 - s * (x * x + y * y), scale.z),
                translation};
}

absl::StatusOr<Affine> LocalTransform(const tinygltf::Node& node) {
  if (!node.matrix.empty()) return AffineFromMatrix(node.matrix);
  Vec3 translation, scale = {1, 1, 1};
  Vec4 rotation = {0, 0, 0, 1};
  if (!node.translation.empty()) {
    if (auto s = CheckArray(node.translation, 3, "translation"); !s.ok()) return s;
    translation = Vec3At(node.translation, 0);
  }
  if (!node.rotation.empty()) {
    if (auto s = CheckArray(node.rotation, 4, "rotation"); !s.ok()) return s;
    const Vec3 xyz = Vec3At(node.rotation, 0);
    rotation = {xyz.x, xyz.y, xyz.z, static_cast<float>(node.rotation[3])};
  }
  if (!node.scale.empty()) {
    if (auto s = CheckArray(node.scale, 3, "scale"); !s.ok()) return s;
    scale = Vec3At(node.scale, 0);
  }
  return AffineFromTrs(translation, rotation, scale);
}

Point64 LocalOrigin(const tinygltf::Node& node) {
  if (!node.matrix.empty()) return {node.matrix[12], node.matrix[13], node.matrix[14]};
  if (node.translation.empty()) return {};
  return {node.translation[0], node.translation[1], node.translation[2]};
}

bool IsInvertible(const Affine& affine) {
  return IsFinite(affine.x) && IsFinite(affine.y) && IsFinite(affine.z) && IsFinite(affine.origin) &&
         std::isnormal(affine.Determinant());
}

Affine RigidPart(const Affine& affine) {
  // Scaled to a largest component of 1 first, so that squares neither overflow nor underflow.
  const auto direction = [](Vec3 v) {
    return Normalize(v / std::fmax(std::fabs(v.x), std::fmax(std::fabs(v.y), std::fabs(v.z))));
  };
  const Vec3 z = direction(affine.z);
  const Vec3 y_raw = direction(affine.y);
  const Vec3 y = Normalize(y_raw - z * Dot(y_raw, z));
  return {Cross(y, z), y, z, affine.origin};
}

}  // namespace lumifold::scene
