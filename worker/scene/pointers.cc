#include "worker/scene/pointers.h"

#include <algorithm>
#include <string_view>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "nlohmann/json.hpp"

namespace lumifold::scene {
namespace {

using nlohmann::json;

struct Pattern {
  std::string_view path;  // # stands for an index
  PointedProperty property = {};
};

/// Near and far planes, and occlusion, change nothing, as without animation.
constexpr Pattern kPatterns[] = {
    {"/cameras/#/orthographic/xmag"},
    {"/cameras/#/orthographic/ymag"},
    {"/cameras/#/orthographic/zfar"},
    {"/cameras/#/orthographic/znear"},
    {"/cameras/#/perspective/aspectRatio"},
    {"/cameras/#/perspective/yfov"},
    {"/cameras/#/perspective/zfar"},
    {"/cameras/#/perspective/znear"},
    {"/extensions/KHR_lights_punctual/lights/#/color", {3}},
    {"/extensions/KHR_lights_punctual/lights/#/intensity"},
    {"/extensions/KHR_lights_punctual/lights/#/range"},
    {"/extensions/KHR_lights_punctual/lights/#/spot/innerConeAngle"},
    {"/extensions/KHR_lights_punctual/lights/#/spot/outerConeAngle"},
    {"/materials/#/alphaCutoff"},
    {"/materials/#/emissiveFactor", {3}},
    {"/materials/#/normalTexture/scale"},
    {"/materials/#/occlusionTexture/strength"},
    {"/materials/#/pbrMetallicRoughness/baseColorFactor", {4}},
    {"/materials/#/pbrMetallicRoughness/metallicFactor"},
    {"/materials/#/pbrMetallicRoughness/roughnessFactor"},
    {"/materials/#/extensions/KHR_materials_anisotropy/anisotropyRotation"},
    {"/materials/#/extensions/KHR_materials_anisotropy/anisotropyStrength"},
    {"/materials/#/extensions/KHR_materials_clearcoat/clearcoatFactor"},
    {"/materials/#/extensions/KHR_materials_clearcoat/clearcoatNormalTexture/scale"},
    {"/materials/#/extensions/KHR_materials_clearcoat/clearcoatRoughnessFactor"},
    {"/materials/#/extensions/KHR_materials_diffuse_transmission/diffuseTransmissionColorFactor", {3}},
    {"/materials/#/extensions/KHR_materials_diffuse_transmission/diffuseTransmissionFactor"},
    {"/materials/#/extensions/KHR_materials_dispersion/dispersion"},
    {"/materials/#/extensions/KHR_materials_emissive_strength/emissiveStrength"},
    {"/materials/#/extensions/KHR_materials_ior/ior"},
    {"/materials/#/extensions/KHR_materials_iridescence/iridescenceFactor"},
    {"/materials/#/extensions/KHR_materials_iridescence/iridescenceIor"},
    {"/materials/#/extensions/KHR_materials_iridescence/iridescenceThicknessMaximum"},
    {"/materials/#/extensions/KHR_materials_iridescence/iridescenceThicknessMinimum"},
    {"/materials/#/extensions/KHR_materials_sheen/sheenColorFactor", {3}},
    {"/materials/#/extensions/KHR_materials_sheen/sheenRoughnessFactor"},
    {"/materials/#/extensions/KHR_materials_specular/specularColorFactor", {3}},
    {"/materials/#/extensions/KHR_materials_specular/specularFactor"},
    {"/materials/#/extensions/KHR_materials_transmission/transmissionFactor"},
    {"/materials/#/extensions/KHR_materials_volume/attenuationColor", {3}},
    {"/materials/#/extensions/KHR_materials_volume/attenuationDistance"},
    {"/materials/#/extensions/KHR_materials_volume/thicknessFactor"},
    {"/nodes/#/extensions/KHR_node_visibility/visible", {1, true}},
};

/// At the end of the pointer of any texture of a material.
constexpr Pattern kTransforms[] = {
    {"Texture/extensions/KHR_texture_transform/offset", {2}},
    {"Texture/extensions/KHR_texture_transform/rotation"},
    {"Texture/extensions/KHR_texture_transform/scale", {2}},
};

bool IsIndex(std::string_view part) {
  return !part.empty() && part.size() <= 9 &&
         std::all_of(part.begin(), part.end(), [](unsigned char c) { return absl::ascii_isdigit(c); });
}

/// The pointer of the object that must be in the document: up to the last index or texture.
std::string ObjectOf(const std::string& pointer) {
  const std::vector<std::string> parts = absl::StrSplit(pointer, '/');
  size_t last = parts.size() - 1;
  while (last > 0 && !IsIndex(parts[last]) && !parts[last].ends_with("Texture")) --last;
  return absl::StrJoin(parts.begin(), parts.begin() + static_cast<std::ptrdiff_t>(last) + 1, "/");
}

}  // namespace

std::string PatternOf(const std::string& pointer) {
  std::vector<std::string> parts = absl::StrSplit(pointer, '/');
  for (std::string& part : parts) {
    if (IsIndex(part)) part = "#";
  }
  return absl::StrJoin(parts, "/");
}

std::optional<PointedProperty> FindPointer(const std::string& pointer) {
  const std::string pattern = PatternOf(pointer);
  for (const Pattern& known : kPatterns) {
    if (pattern == known.path) return known.property;
  }
  if (!pattern.starts_with("/materials/#/")) return std::nullopt;
  for (const Pattern& transform : kTransforms) {
    if (pattern.ends_with(transform.path)) return transform.property;
  }
  return std::nullopt;
}

absl::Status SetPointed(const std::string& pointer, std::span<const float> values, json* root) {
  const std::string object = ObjectOf(pointer);
  if (!root->contains(json::json_pointer(object)))
    return absl::InvalidArgumentError(absl::StrCat("animates ", pointer, ", but there is no ", object));
  const std::optional<PointedProperty> property = FindPointer(pointer);
  if (!property.has_value())
    return absl::InvalidArgumentError(absl::StrCat("animates ", pointer, ", which is not read"));
  json& target = (*root)[json::json_pointer(pointer)];
  if (property->is_flag)
    target = values[0] != 0;
  else if (property->numbers == 1)
    target = values[0];
  else
    target = std::vector<float>(values.begin(), values.end());
  return absl::OkStatus();
}

}  // namespace lumifold::scene
