#include "worker/scene/materials.h"

#include <algorithm>
#include <array>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "filter/image/portable_math.h"
#include "worker/scene/fields.h"
#include "worker/scene/textures.h"

namespace lumifold::scene {
namespace {

constexpr char kTextureTransform[] = "KHR_texture_transform";
constexpr float kFullReflection = 1e6f;    // an ior whose reflectance is 1 but for rounding
constexpr double kMaxDispersion = 100;     // fifty times that of rutile
constexpr double kMaxFilmThickness = 1e6;  // nanometres: far above what shows interference
constexpr double kMaxInt = std::numeric_limits<int>::max();
constexpr double kMaxFloat = std::numeric_limits<float>::max();

/// Converts one material.
class MaterialReader {
 public:
  MaterialReader(const tinygltf::Material& source, const std::string& place, TextureTable* textures,
                 Diagnostics* diagnostics)
      : source_(source), fields_(place, diagnostics), textures_(textures), diagnostics_(diagnostics) {}

  absl::StatusOr<Material> Read() {
    material_.name = source_.name;
    ReadMetallicRoughness();
    ReadEmission();
    ReadAlpha();
    material_.normal_map.texture = Ref(source_.normalTexture);
    material_.normal_map.scale = fields_.Finite(source_.normalTexture.scale, "normalTexture.scale");
    material_.double_sided = source_.doubleSided;
    material_.unlit = Extension("KHR_materials_unlit") != nullptr;
    ReadIor();
    ReadSpecular();
    ReadTransmission();
    ReadVolume();
    ReadDispersion();
    ReadClearcoat();
    ReadSheen();
    ReadAnisotropy();
    ReadDiffuseTransmission();
    ReadIridescence();
    ReadSpecularGlossiness();
    if (!fields_.status().ok()) return fields_.status();
    if (!texture_status_.ok()) return WithContext(texture_status_, fields_.place());
    return std::move(material_);
  }

 private:
  const tinygltf::Value* Extension(const char* name) const { return FindExtension(source_.extensions, name); }

  float Fraction(double value, const char* field) { return fields_.Clamped(value, 0, 1, field); }

  Vec3 FractionColor(const std::array<double, 3>& c, const char* field) {
    return {Fraction(c[0], field), Fraction(c[1], field), Fraction(c[2], field)};
  }

  void ReadMetallicRoughness() {
    const tinygltf::PbrMetallicRoughness& pbr = source_.pbrMetallicRoughness;
    const std::vector<double>& color = pbr.baseColorFactor;  // tinygltf has checked that it is 4 long
    material_.base.color = FractionColor({color[0], color[1], color[2]}, "baseColorFactor");
    material_.base.alpha = Fraction(color[3], "baseColorFactor");
    material_.base.color_texture = Ref(pbr.baseColorTexture);
    material_.base.metallic = Fraction(pbr.metallicFactor, "metallicFactor");
    material_.base.roughness = Fraction(pbr.roughnessFactor, "roughnessFactor");
    material_.base.metallic_roughness_texture = Ref(pbr.metallicRoughnessTexture);
  }

  void ReadEmission() {
    double strength = 1;
    if (const auto* extension = Extension("KHR_materials_emissive_strength")) {
      strength = fields_.Number(*extension, "emissiveStrength", strength);
    }
    const auto radiance = [&](size_t channel) {
      return fields_.Clamped(source_.emissiveFactor[channel] * strength, 0, kMaxFloat, "emissiveFactor");
    };
    material_.emission.radiance = {radiance(0), radiance(1), radiance(2)};
    // A texture multiplied by 0 is not decoded.
    if (material_.emission.radiance != Vec3{0, 0, 0})
      material_.emission.texture = Ref(source_.emissiveTexture);
  }

  void ReadAlpha() {
    const std::string& mode = source_.alphaMode;
    if (mode == "MASK") {
      material_.alpha_mode = AlphaMode::kMask;
    } else if (mode == "BLEND") {
      material_.alpha_mode = AlphaMode::kBlend;
    } else if (!mode.empty() && mode != "OPAQUE") {
      fields_.Fail(absl::StrCat("alphaMode \"", mode, "\" is not glTF's"));
    }
    material_.alpha_cutoff = fields_.Clamped(source_.alphaCutoff, 0, kMaxFloat, "alphaCutoff");
  }

  void ReadIor() {
    const auto* extension = Extension("KHR_materials_ior");
    if (extension == nullptr) return;
    const double ior = fields_.Number(*extension, "ior", 1.5);
    // 0 stands for a surface that reflects everything at all angles, so that its specular colour is that.
    material_.ior = ior == 0 ? kFullReflection : fields_.Clamped(ior, 1, 1000, "ior");
  }

  void ReadSpecular() {
    const auto* extension = Extension("KHR_materials_specular");
    if (extension == nullptr) return;
    material_.specular.factor = Fraction(fields_.Number(*extension, "specularFactor", 1), "specularFactor");
    const auto color = fields_.Numbers<3>(*extension, "specularColorFactor", {1, 1, 1});
    const auto channel = [&](size_t i) {
      return fields_.Clamped(color[i], 0, kMaxFloat, "specularColorFactor");
    };
    material_.specular.color = {channel(0), channel(1), channel(2)};
    material_.specular.factor_texture = ExtensionRef(*extension, "specularTexture");
    material_.specular.color_texture = ExtensionRef(*extension, "specularColorTexture");
  }

  void ReadTransmission() {
    const auto* extension = Extension("KHR_materials_transmission");
    if (extension == nullptr) return;
    material_.transmission.factor =
        Fraction(fields_.Number(*extension, "transmissionFactor", 0), "transmissionFactor");
    // A texture multiplied by 0 is not decoded.
    if (material_.transmission.factor > 0)
      material_.transmission.texture = ExtensionRef(*extension, "transmissionTexture");
  }

  void ReadClearcoat() {
    const auto* extension = Extension("KHR_materials_clearcoat");
    if (extension == nullptr) return;
    material_.clearcoat.factor =
        Fraction(fields_.Number(*extension, "clearcoatFactor", 0), "clearcoatFactor");
    material_.clearcoat.roughness =
        Fraction(fields_.Number(*extension, "clearcoatRoughnessFactor", 0), "clearcoatRoughnessFactor");
    if (material_.clearcoat.factor == 0) return;
    material_.clearcoat.factor_texture = ExtensionRef(*extension, "clearcoatTexture");
    material_.clearcoat.roughness_texture = ExtensionRef(*extension, "clearcoatRoughnessTexture");
    material_.clearcoat.normal_map.texture = ExtensionRef(*extension, "clearcoatNormalTexture");
    if (material_.clearcoat.normal_map.texture.texture != kNone) {
      material_.clearcoat.normal_map.scale =
          fields_.Finite(fields_.Number(extension->Get("clearcoatNormalTexture"), "scale", 1),
                         "clearcoatNormalTexture.scale");
    }
  }

  void ReadSheen() {
    const auto* extension = Extension("KHR_materials_sheen");
    if (extension == nullptr) return;
    material_.sheen.color =
        FractionColor(fields_.Numbers<3>(*extension, "sheenColorFactor", {0, 0, 0}), "sheenColorFactor");
    material_.sheen.roughness =
        Fraction(fields_.Number(*extension, "sheenRoughnessFactor", 0), "sheenRoughnessFactor");
    if (material_.sheen.color == Vec3{0, 0, 0}) return;
    material_.sheen.color_texture = ExtensionRef(*extension, "sheenColorTexture");
    material_.sheen.roughness_texture = ExtensionRef(*extension, "sheenRoughnessTexture");
  }

  void ReadAnisotropy() {
    const auto* extension = Extension("KHR_materials_anisotropy");
    if (extension == nullptr) return;
    Material::Base::Anisotropy& anisotropy = material_.base.anisotropy;
    anisotropy.strength = Fraction(fields_.Number(*extension, "anisotropyStrength", 0), "anisotropyStrength");
    if (anisotropy.strength == 0) return;
    const double angle = fields_.Number(*extension, "anisotropyRotation", 0);
    SinCos(fields_.Clamped(angle, -1000, 1000, "anisotropyRotation"), &anisotropy.direction.y,
           &anisotropy.direction.x);
    anisotropy.texture = ExtensionRef(*extension, "anisotropyTexture");
  }

  void ReadDiffuseTransmission() {
    const auto* extension = Extension("KHR_materials_diffuse_transmission");
    if (extension == nullptr) return;
    Material::Base::DiffuseTransmission& transmission = material_.base.diffuse_transmission;
    transmission.factor =
        Fraction(fields_.Number(*extension, "diffuseTransmissionFactor", 0), "diffuseTransmissionFactor");
    if (transmission.factor == 0) return;
    transmission.color =
        FractionColor(fields_.Numbers<3>(*extension, "diffuseTransmissionColorFactor", {1, 1, 1}),
                      "diffuseTransmissionColorFactor");
    transmission.factor_texture = ExtensionRef(*extension, "diffuseTransmissionTexture");
    transmission.color_texture = ExtensionRef(*extension, "diffuseTransmissionColorTexture");
  }

  void ReadIridescence() {
    const auto* extension = Extension("KHR_materials_iridescence");
    if (extension == nullptr) return;
    Material::Iridescence& film = material_.iridescence;
    film.factor = Fraction(fields_.Number(*extension, "iridescenceFactor", 0), "iridescenceFactor");
    if (film.factor == 0) return;
    film.ior = fields_.Clamped(fields_.Number(*extension, "iridescenceIor", 1.3), 1, 1000, "iridescenceIor");
    const auto thickness = [&](const char* field, double otherwise) {
      return fields_.Clamped(fields_.Number(*extension, field, otherwise), 0, kMaxFilmThickness, field);
    };
    film.min_thickness_nm = thickness("iridescenceThicknessMinimum", 100);
    film.max_thickness_nm = thickness("iridescenceThicknessMaximum", 400);
    film.factor_texture = ExtensionRef(*extension, "iridescenceTexture");
    film.thickness_texture = ExtensionRef(*extension, "iridescenceThicknessTexture");
  }

  /// Replaces the metallic-roughness values, which the extension's text ranks below these, by those of a
  /// dielectric that reflects the given colour at all angles.
  void ReadSpecularGlossiness() {
    const auto* extension = Extension("KHR_materials_pbrSpecularGlossiness");
    if (extension == nullptr) return;
    const auto diffuse = fields_.Numbers<4>(*extension, "diffuseFactor", {1, 1, 1, 1});
    const auto specular = fields_.Numbers<3>(*extension, "specularFactor", {1, 1, 1});
    const float glossiness = Fraction(fields_.Number(*extension, "glossinessFactor", 1), "glossinessFactor");
    material_.base.color = FractionColor({diffuse[0], diffuse[1], diffuse[2]}, "diffuseFactor");
    material_.base.alpha = Fraction(diffuse[3], "diffuseFactor");
    material_.base.color_texture = ExtensionRef(*extension, "diffuseTexture");
    material_.base.metallic = 0;
    material_.base.roughness = 1 - glossiness;
    material_.base.metallic_roughness_texture = {};
    material_.ior = kFullReflection;
    material_.specular = {};
    material_.specular.color = FractionColor(specular, "specularFactor");
    const TextureRef both = ExtensionRef(*extension, "specularGlossinessTexture");
    if (both.texture == kNone || !texture_status_.ok()) return;
    material_.specular.color_texture = both;
    material_.base.roughness = 1;
    material_.base.metallic_roughness_texture = both;
    material_.base.metallic_roughness_texture.texture =
        textures_->RoughnessOfGlossiness(both.texture, glossiness);
  }

  void ReadVolume() {
    const auto* extension = Extension("KHR_materials_volume");
    if (extension == nullptr) return;
    material_.volume.is_solid = fields_.Number(*extension, "thicknessFactor", 0) > 0;
    const double distance = fields_.Number(*extension, "attenuationDistance", 0);
    material_.volume.attenuation_distance = fields_.Clamped(distance, 0, kMaxFloat, "attenuationDistance");
    material_.volume.attenuation_color =
        FractionColor(fields_.Numbers<3>(*extension, "attenuationColor", {1, 1, 1}), "attenuationColor");
    ReportUnusedTexture(*extension, "thicknessTexture", "the shape itself is what light goes through");
  }

  /// Only solid glass refracts.
  void ReadDispersion() {
    const auto* extension = Extension("KHR_materials_dispersion");
    if (extension == nullptr || !material_.volume.is_solid || material_.transmission.factor <= 0) return;
    material_.volume.dispersion =
        fields_.Clamped(fields_.Number(*extension, "dispersion", 0), 0, kMaxDispersion, "dispersion");
  }

  void ReportUnusedTexture(const tinygltf::Value& extension, const char* field, const char* instead) {
    if (extension.Has(field)) {
      diagnostics_->Count(absl::StrCat(field, " is not supported: ", instead), fields_.place());
    }
  }

  /// For tinygltf's TextureInfo and NormalTextureInfo.
  template <typename Info>
  TextureRef Ref(const Info& info) {
    return MakeRef(info.index, info.texCoord, FindExtension(info.extensions, kTextureTransform));
  }

  /// The same for a texture of an extension, which tinygltf does not parse.
  TextureRef ExtensionRef(const tinygltf::Value& extension, const char* field) {
    if (!extension.Has(field)) return {};
    const tinygltf::Value& info = extension.Get(field);
    const double index = info.IsObject() ? fields_.Number(info, "index", kNone) : kNone;
    if (!(index >= 0 && index <= kMaxInt)) {
      fields_.Fail(absl::StrCat(field, " has no index"));
      return {};
    }
    const tinygltf::Value* transform = nullptr;
    if (info.Has("extensions") && info.Get("extensions").Has(kTextureTransform)) {
      transform = &info.Get("extensions").Get(kTextureTransform);
    }
    return MakeRef(static_cast<int>(index), UvSet(info, 0), transform);
  }

  int UvSet(const tinygltf::Value& object, int otherwise) {
    return static_cast<int>(std::clamp<double>(fields_.Number(object, "texCoord", otherwise), -1, kMaxInt));
  }

  TextureRef MakeRef(int index, int uv_set, const tinygltf::Value* transform) {
    TextureRef ref;
    if (index == kNone || !texture_status_.ok()) return ref;
    const auto texture = textures_->Use(index);
    if (!texture.ok()) {
      texture_status_ = texture.status();
      return ref;
    }
    ref.texture = *texture;
    if (transform != nullptr && transform->IsObject()) {
      uv_set = UvSet(*transform, uv_set);
      ReadTransform(*transform, &ref);
    }
    ref.uv_set = uv_set == 1 ? 1 : 0;
    if (ref.uv_set != uv_set) {
      diagnostics_->Count("textures that want another UV set than 0 or 1 use set 0", fields_.place());
    }
    return ref;
  }

  /// Rotation is counter-clockwise in a picture whose v points down. Viewers, exporters and the extension's
  /// text agree on that; the extension's GLSL example rotates the other way.
  void ReadTransform(const tinygltf::Value& extension, TextureRef* ref) {
    const auto offset = fields_.Numbers<2>(extension, "offset", {0, 0});
    const auto scale = fields_.Numbers<2>(extension, "scale", {1, 1});
    const float angle = fields_.Clamped(fields_.Number(extension, "rotation", 0), -1000, 1000, "rotation");
    const float scale_u = fields_.Finite(scale[0], "scale"), scale_v = fields_.Finite(scale[1], "scale");
    float sine = 0, cosine = 1;
    SinCos(angle, &sine, &cosine);
    ref->row_u = {cosine * scale_u, sine * scale_v};
    ref->row_v = {-sine * scale_u, cosine * scale_v};
    ref->offset = {fields_.Finite(offset[0], "offset"), fields_.Finite(offset[1], "offset")};
  }

  const tinygltf::Material& source_;
  FieldReader fields_;
  TextureTable* textures_;
  Diagnostics* diagnostics_;
  Material material_;
  absl::Status texture_status_;
};

}  // namespace

absl::Status ReadMaterials(const Document& document, const std::vector<bool>& in_use,
                           const AssetReader& reader, const LoadOptions& options, Scene* scene,
                           Diagnostics* diagnostics) {
  TextureTable textures(document, options, scene, diagnostics);
  const auto& sources = document.model.materials;
  scene->materials.resize(sources.size());
  for (size_t i = 0; i < sources.size(); ++i) {
    if (!in_use[i]) continue;
    const std::string place = Place("material", static_cast<int64_t>(i), sources[i].name);
    auto material = MaterialReader(sources[i], place, &textures, diagnostics).Read();
    if (!material.ok()) return material.status();
    scene->materials[i] = *std::move(material);
  }
  return textures.DecodeImages(reader);
}

}  // namespace lumifold::scene
