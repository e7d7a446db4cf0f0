#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "worker/scene/vec.h"

/// The renderer's scene: plain arrays in metres, seconds and linear Rec. 709 RGB, right-handed with +Y up as
/// in glTF. A Scene from the loader is valid: every index is in range, every number is finite.
namespace lumifold::scene {

/// The index of no object.
inline constexpr int kNone = -1;

/// A decoded picture: RGBA as in the file, rows from the top (v = 0 is the first row, as in glTF).
struct ImageData {
  int width = 0;
  int height = 0;
  std::vector<uint8_t> rgba;
  std::vector<uint16_t> rgba16 = {};  // in its place, of a picture with 16 bits a channel

  bool is_deep() const { return !rgba16.empty(); }
  size_t bytes() const { return rgba.size() + rgba16.size() * sizeof(uint16_t); }
  /// The one of the two that has codes of this type.
  template <typename Code>
  const std::vector<Code>& codes() const {
    if constexpr (sizeof(Code) == 1)
      return rgba;
    else
      return rgba16;
  }
};
/// Scenes that show the same picture share it.
using SharedImage = std::shared_ptr<const ImageData>;

enum class Wrap { kRepeat, kMirror, kClamp };

/// A picture with its wrap modes and its filter.
struct Texture {
  int image = kNone;
  Wrap wrap_s = Wrap::kRepeat;
  Wrap wrap_t = Wrap::kRepeat;
  bool nearest = false;  // nearest texel instead of bilinear
};

/// A material's reference to a texture: uv' = offset + (row_u, row_v) * uv (KHR_texture_transform).
struct TextureRef {
  int texture = kNone;
  int uv_set = 0;
  Vec2 row_u = {1, 0};
  Vec2 row_v = {0, 1};
  Vec2 offset = {0, 0};
};

enum class AlphaMode { kOpaque, kMask, kBlend };

struct NormalMap {
  TextureRef texture;
  float scale = 1;
};

/// glTF's metallic-roughness material and the extensions that the renderer supports, a struct for each.
/// Texture values multiply the factors.
struct Material {
  /// glTF's pbrMetallicRoughness.
  struct Base {
    /// KHR_materials_anisotropy: one direction of the base's microfacets is rougher.
    struct Anisotropy {
      float strength = 0;
      Vec2 direction = {1, 0};  // of the greater roughness, along tangent and bitangent; turns the texture's
      TextureRef texture;       // R and G direction, B strength
    };
    /// KHR_materials_diffuse_transmission: the part of the diffuse base's light that leaves behind it.
    struct DiffuseTransmission {
      float factor = 0;
      TextureRef factor_texture;  // A
      Vec3 color = {1, 1, 1};     // in place of the base colour
      TextureRef color_texture;   // sRGB
    };
    Vec3 color = {1, 1, 1};
    float alpha = 1;
    TextureRef color_texture;  // sRGB colour, linear alpha
    float metallic = 1;
    float roughness = 1;                    // perceptual: GGX alpha = roughness^2
    TextureRef metallic_roughness_texture;  // G roughness, B metallic
    Anisotropy anisotropy;
    DiffuseTransmission diffuse_transmission;
  };
  struct Emission {
    Vec3 radiance = {0, 0, 0};  // emissive_strength multiplied in
    TextureRef texture;         // sRGB
  };
  /// KHR_materials_specular.
  struct Specular {
    float factor = 1;
    TextureRef factor_texture;  // A
    Vec3 color = {1, 1, 1};
    TextureRef color_texture;  // sRGB
  };
  /// KHR_materials_transmission.
  struct Transmission {
    float factor = 0;
    TextureRef texture;  // R
  };
  /// KHR_materials_clearcoat: a dielectric coat of ior 1.5.
  struct Clearcoat {
    float factor = 0;              // its weight
    TextureRef factor_texture;     // R
    float roughness = 0;           // perceptual
    TextureRef roughness_texture;  // G
    NormalMap normal_map;          // the base's does not affect the coat
  };
  /// KHR_materials_sheen.
  struct Sheen {
    Vec3 color = {0, 0, 0};        // reflectance of the fibres; black: none
    TextureRef color_texture;      // sRGB
    float roughness = 0;           // perceptual: sheen alpha = roughness^2
    TextureRef roughness_texture;  // A
  };
  /// KHR_materials_iridescence: a film about as thin as a wavelength of light.
  struct Iridescence {
    float factor = 0;
    TextureRef factor_texture;  // R
    float ior = 1.3f;
    float min_thickness_nm = 100;  // where the texture is 0
    float max_thickness_nm = 400;
    TextureRef thickness_texture;  // G
  };
  /// KHR_materials_volume.
  struct Volume {
    bool is_solid = false;  // thickness > 0: refracts; else thin
    Vec3 attenuation_color = {1, 1, 1};
    float attenuation_distance = 0;  // metres; 0: infinite
    float dispersion = 0;  // KHR_materials_dispersion: 20 over the Abbe number of solid glass, else 0
  };

  std::string name;
  Base base;
  NormalMap normal_map;
  Emission emission;
  AlphaMode alpha_mode = AlphaMode::kOpaque;
  float alpha_cutoff = 0.5f;
  bool double_sided = false;
  bool unlit = false;  // KHR_materials_unlit: emits the base colour, reflects nothing
  float ior = 1.5f;    // KHR_materials_ior
  Specular specular;
  Transmission transmission;
  Clearcoat clearcoat;
  Sheen sheen;
  Iridescence iridescence;
  Volume volume;
};

/// A texture reference of a material and its colour encoding.
struct TextureUse {
  const TextureRef* ref;
  bool srgb;
};

/// All of a material's references, including those that name no texture.
std::array<TextureUse, 17> TexturesOf(const Material& material);

/// Triangles of one material. Vectors other than positions and triangles are empty or as long as positions.
struct Mesh {
  std::vector<Vec3> positions;  // with room for one more, Embree can share them: it reads 16 bytes of each
  std::vector<Vec3> normals;    // unit length; empty: flat
  std::vector<Vec2> uvs[2];     // TEXCOORD_0, TEXCOORD_1
  std::vector<Vec4> tangents;   // xyz unit, w = handedness
  std::vector<Vec4> colors;     // linear RGBA
  std::vector<uint32_t> triangles;  // 3 indices each, counter-clockwise seen from the front
  int material = kNone;             // kNone: glTF's default material
};

/// A mesh placed in the world.
struct Instance {
  int mesh = kNone;
  Affine world_from_object;
  std::string name;
};

/// Looks down its -Z with +Y up.
struct Camera {
  enum class Kind { kPerspective, kOrthographic };
  std::string name;
  Kind kind = Kind::kPerspective;
  float yfov = 0.8f;  // vertical field of view in radians, kPerspective
  float xmag = 1;     // half width and half height of the picture in metres, kOrthographic
  float ymag = 1;
  float aspect = 0;  // width / height given by the file; 0: none
  Affine world_from_camera;
};

/// A punctual light (KHR_lights_punctual), in the photometric units of the file.
struct PunctualLight {
  enum class Kind { kPoint, kSpot, kDirectional };
  std::string name;
  Kind kind = Kind::kPoint;
  Vec3 color = {1, 1, 1};      // linear Rec. 709, multiplies intensity
  float intensity = 1;         // candela (lm/sr) for points and spots, lux (lm/m^2) for directional ones
  float range = 0;             // metres beyond which points and spots emit nothing; 0: unlimited
  float inner_cone_angle = 0;  // radians from the axis, kSpot: full intensity within the inner angle,
  float outer_cone_angle = 0.78539816f;  // none beyond the outer one; inner < outer <= pi/2
  Affine world_from_light;               // rigid: emits along its -Z; directional lights ignore the origin
};

struct Scene {
  /// Where the file has the origin of all coordinates here, in metres: 0 unless the scene lies so far from
  /// its own that floats would not hold its details.
  std::array<double, 3> origin = {};
  std::vector<Mesh> meshes;
  std::vector<Instance> instances;
  std::vector<Instance> catchers;  // seen by the camera alone, and only the shadows on them
  std::vector<Material> materials;
  std::vector<Texture> textures;
  std::vector<SharedImage> images;
  std::vector<Camera> cameras;
  std::vector<PunctualLight> lights;
  std::vector<std::string> animations;  // names, by number
  std::vector<std::string> variants;    // names, by number
  std::vector<std::string> extensions;  // that the file uses
  bool animated = false;                // the Scene may differ at another time
  double animation_duration = 0;        // seconds from 0 to the last keyframe of all animations
  /// Messages for the artist, one line each: extensions left out, triangles dropped.
  std::vector<std::string> warnings;
};

/// An axis-aligned box; empty while min > max.
struct Bounds {
  Vec3 min = {1e30f, 1e30f, 1e30f};
  Vec3 max = {-1e30f, -1e30f, -1e30f};
  bool IsEmpty() const { return min.x > max.x; }
};

/// A box around all instances in world space: the union of the transformed boxes of their meshes.
Bounds WorldBounds(const Scene& scene);

/// Adds a catcher of shadows: a level square just below the instances, wide enough for long shadows. A scene
/// without instances gets none.
void AddShadowGround(Scene* scene);

/// The camera of this name or number; the first one if `name` is empty. A scene without cameras gets a
/// camera that views all of it from three quarters and slightly above, as large as a frame of this aspect
/// ratio (width over height) allows. Error: kNotFound, naming the cameras that exist.
absl::StatusOr<Camera> FindCamera(const Scene& scene, const std::string& name, float aspect);

}  // namespace lumifold::scene
