#include "worker/scene/variants.h"

#include "worker/scene/choice.h"
#include "worker/scene/fields.h"
#include "worker/scene/scene.h"

namespace lumifold::scene {
namespace {

constexpr char kVariants[] = "KHR_materials_variants";

/// Member `key` of an extension, an array; empty for anything else.
std::vector<tinygltf::Value> ArrayOf(const tinygltf::Value* extension, const char* key) {
  if (extension == nullptr || !extension->Has(key) || !extension->Get(key).IsArray()) return {};
  return extension->Get(key).Get<tinygltf::Value::Array>();
}

bool Names(const tinygltf::Value& mapping, int variant) {
  if (!mapping.IsObject()) return false;
  for (const tinygltf::Value& named : ArrayOf(&mapping, "variants")) {
    if (named.IsInt() && named.Get<int>() == variant) return true;
  }
  return false;
}

}  // namespace

std::vector<std::string> VariantNames(const tinygltf::Model& model) {
  std::vector<std::string> names;
  for (const tinygltf::Value& variant : ArrayOf(FindExtension(model.extensions, kVariants), "variants")) {
    const bool has_name = variant.IsObject() && variant.Has("name") && variant.Get("name").IsString();
    names.push_back(has_name ? variant.Get("name").Get<std::string>() : "");
  }
  return names;
}

absl::StatusOr<int> FindVariant(const std::vector<std::string>& names, const std::string& wanted) {
  if (wanted.empty()) return kNone;
  return Choose("variant", names, wanted);
}

int MaterialOf(const tinygltf::Primitive& primitive, int variant) {
  if (variant == kNone) return primitive.material;
  for (const tinygltf::Value& mapping : ArrayOf(FindExtension(primitive.extensions, kVariants), "mappings")) {
    if (Names(mapping, variant) && mapping.Has("material") && mapping.Get("material").IsInt())
      return mapping.Get("material").Get<int>();
  }
  return primitive.material;
}

std::vector<bool> MaterialsInUse(const tinygltf::Model& model, int variant) {
  const bool has_variants = FindExtension(model.extensions, kVariants) != nullptr;
  std::vector<bool> in_use(model.materials.size(), !has_variants);
  for (const tinygltf::Mesh& mesh : model.meshes) {
    for (const tinygltf::Primitive& primitive : mesh.primitives) {
      const int material = MaterialOf(primitive, variant);
      if (material >= 0 && static_cast<size_t>(material) < in_use.size()) in_use[material] = true;
    }
  }
  return in_use;
}

}  // namespace lumifold::scene
