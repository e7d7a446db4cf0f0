#include "worker/scene/extensions.h"

#include <algorithm>
#include <set>
#include <string_view>

#include "absl/strings/str_cat.h"

namespace lumifold::scene {
namespace {

constexpr std::string_view kSupported[] = {
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_webp",
    "KHR_animation_pointer",
    "KHR_draco_mesh_compression",
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_dispersion",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_visibility",
    "KHR_texture_basisu",
    "KHR_texture_transform",
};

struct Loss {
  std::string_view extension;
  const char* what_is_lost;
};

constexpr Loss kLosses[] = {
    {"EXT_lights_image_based", "its environment light is left out"},
};

bool IsSupported(std::string_view extension) {
  return std::find(std::begin(kSupported), std::end(kSupported), extension) != std::end(kSupported);
}

const char* WhatIsLost(std::string_view extension) {
  for (const Loss& loss : kLosses) {
    if (loss.extension == extension) return loss.what_is_lost;
  }
  return "what it describes is left out";
}

}  // namespace

absl::Status CheckExtensions(const std::vector<std::string>& used, const std::vector<std::string>& required,
                             Diagnostics* diagnostics) {
  for (const std::string& extension : required) {
    if (!IsSupported(extension)) {
      return absl::InvalidArgumentError(
          absl::StrCat("requires the extension ", extension, ", which is not supported"));
    }
  }
  std::set<std::string> noted;
  for (const std::string& extension : used) {
    if (IsSupported(extension) || !noted.insert(extension).second) continue;
    diagnostics->Note(absl::StrCat("extension ", extension, " is not supported: ", WhatIsLost(extension)));
  }
  return absl::OkStatus();
}

}  // namespace lumifold::scene
