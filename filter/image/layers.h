#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "absl/functional/function_ref.h"

/// The names of channels, the same in units, films and OpenEXR files. Units hold sums; films and files hold
/// means.
namespace lumifold::layers {

// Colour layers, each LAYER.R LAYER.G LAYER.B. The finished picture itself is plain R G B A.
inline constexpr std::string_view kBeauty;                 // no prefix
inline constexpr std::string_view kNoisy = "noisy";        // C, the radiance of the whole path
inline constexpr std::string_view kDirect = "direct";      // D
inline constexpr std::string_view kIndirect = "indirect";  // I
inline constexpr std::string_view kAlbedo = "albedo";      // T
inline constexpr std::string_view kEmission = "emission";  // E
inline constexpr std::string_view kGlossy = "glossy";      // G, glossy lobes of the first surface over S
inline constexpr std::string_view kGlossyAlbedo =
    "glossy_albedo";                                             // S, the directional albedo of those lobes
inline constexpr std::string_view kTransmitted = "transmitted";  // only in pictures of other renderers:
inline constexpr std::string_view kTransmittance = "transmittance";  // transmitted light, and its factor
inline constexpr std::string_view kReflection1 = "reflection1";      // C - (D + I) T - E, only in files

// Single channels of the geometry unit.
inline constexpr std::string_view kNormalX = "N.X";
inline constexpr std::string_view kNormalY = "N.Y";
inline constexpr std::string_view kNormalZ = "N.Z";
inline constexpr std::string_view kPlanarDepth = "Z";        // along the view axis; 0 where nothing is hit
inline constexpr std::string_view kDistance = "distance.Z";  // along the ray; 0 where nothing is hit
inline constexpr std::string_view kObjectId = "id.Y";  // 1-based instance number; 0 where nothing is hit
inline constexpr std::string_view kMask = "mask.Y";    // fraction of samples on a surface with a diffuse lobe
inline constexpr std::string_view kAlpha = "A";        // coverage: fraction of samples that hit anything
/// Only in pictures of a lens: diameter in pixels of the disc that the lens makes of a point, the largest of
/// the points that the rays of the pixel hit.
inline constexpr std::string_view kBlur = "blur.Y";
inline constexpr std::string_view kRoughness = "roughness.Y";  // GGX alpha of the reflecting lobe; 1 without

// Of pictures with a transparent background. All are means over the samples of the pixel; the halves of light
// and shadow are needed since their ratio is noisy.
inline constexpr std::string_view kOpacity = "opacity.Y";  // fraction on a surface that is shown
inline constexpr std::string_view kCatcher = "catcher.Y";  // fraction on a surface that shows shadows alone
inline constexpr std::array<std::string_view, 2> kCatcherLight = {"catcher_light_a.Y", "catcher_light_b.Y"};
inline constexpr std::array<std::string_view, 2> kCatcherShadow = {"catcher_shadow_a.Y",
                                                                   "catcher_shadow_b.Y"};
inline constexpr std::string_view kShadow = "shadow.Y";  // filtered: the part of A that shadows are

// Sample counts of the halves, per pixel.
inline constexpr std::string_view kSamplesA = "samples_a.Y";
inline constexpr std::string_view kSamplesB = "samples_b.Y";

// Coordinates of a pixel in the whole frame, of edge sets and fragments; their other channels have the names
// above.
inline constexpr std::string_view kPixelX = "pixel.X";
inline constexpr std::string_view kPixelY = "pixel.Y";

// The surface of a fragment, see SurfaceKey.
inline constexpr std::string_view kSurface = "surface.Y";

/// The layers that are kept in two independent halves, in the order they are stored.
inline constexpr std::array<std::string_view, 4> kHalved = {kNoisy, kDirect, kIndirect, kGlossy};

/// The layers besides C that a picture or a unit carries; without `glossy` neither G nor S.
struct Carried {
  bool direct = true;
  bool indirect = true;
  bool albedo = true;
  bool emission = true;
  bool glossy = true;
  /// A lens makes T, E and S vary within a pixel, those of levels too: they are in halves, beside kBlur.
  bool lens = false;

  /// Whether this layer of kHalved or kWhole is there; C always is.
  bool Has(std::string_view layer) const;
  friend bool operator==(const Carried&, const Carried&) = default;
};

/// Light of further lobes of the first surface that a film may have, and the layer that multiplies it.
struct LobeLayer {
  std::string_view light;
  std::string_view factor;
};
inline constexpr std::array<LobeLayer, 2> kLobeLayers = {
    {{kGlossy, kGlossyAlbedo}, {kTransmitted, kTransmittance}}};

/// The layers that are kept once, over all samples.
inline constexpr std::array<std::string_view, 3> kWhole = {kAlbedo, kEmission, kGlossyAlbedo};

/// What a fragment has: features, light in halves, and the layers that multiply the light.
inline constexpr std::array<std::string_view, 4> kFragmentFeatures = {kNormalX, kNormalY, kNormalZ,
                                                                      kDistance};
inline constexpr std::array<std::string_view, 3> kFragmentHalved = {kDirect, kIndirect, kGlossy};
inline constexpr std::array<std::string_view, 3> kFragmentWhole = {kAlbedo, kEmission, kGlossyAlbedo};

/// A level: the surface reached after `depth` delta events, the first of which was a reflection or a
/// transmission.
enum class Branch { kReflection, kTransmission };
inline constexpr int kMaxDepth = 3;
inline constexpr size_t kLevelCount = 2 * kMaxDepth;

struct Level {
  Branch branch = Branch::kReflection;
  int depth = 1;  // 1 to kMaxDepth

  /// Number of the level in [0, kLevelCount): reflection 1, 2, 3, then transmission 1, 2, 3.
  constexpr size_t index() const {
    return static_cast<size_t>(branch) * kMaxDepth + static_cast<size_t>(depth - 1);
  }
  static constexpr Level Of(size_t index) {
    return {static_cast<Branch>(index / kMaxDepth), static_cast<int>(index % kMaxDepth) + 1};
  }
};

/// The channels of a level: the layers kept in halves (means over the samples that hit a diffuse surface
/// there, counted by the level's own kSamplesA and kSamplesB), the layers kept once (means over all samples
/// of the pixel, multiplied by the throughput of the path up to that level), and its features.
inline constexpr std::array<std::string_view, 2> kLevelHalved = {kDirect, kIndirect};
inline constexpr std::array<std::string_view, 2> kLevelWhole = {kAlbedo, kEmission};
inline constexpr std::array<std::string_view, 6> kLevelFeatures = {kNormalX,  kNormalY, kNormalZ,
                                                                   kDistance, kMask,    kObjectId};

/// "reflection1", "transmission3".
inline std::string NameOf(Level level) {
  return (level.branch == Branch::kReflection ? "reflection" : "transmission") + std::to_string(level.depth);
}

/// The level's own layer or channel: "direct" -> "reflection1_direct", "N.X" -> "reflection1_N.X".
inline std::string OfLevel(Level level, std::string_view name) {
  return NameOf(level) + "_" + std::string(name);
}

/// "direct" -> "direct_a" / "direct_b".
inline std::string HalfA(std::string_view layer) { return std::string(layer) + "_a"; }
inline std::string HalfB(std::string_view layer) { return std::string(layer) + "_b"; }

/// "direct" -> direct.R direct.G direct.B; "" -> R G B.
inline std::array<std::string, 3> ColorChannels(std::string_view layer) {
  const std::string prefix = layer.empty() ? "" : std::string(layer) + ".";
  return {prefix + "R", prefix + "G", prefix + "B"};
}

/// The channels that a pass unit has for a level that some sample has reached, all of them sums: the halves
/// of kLevelHalved ("reflection1_direct_a.R" ...), kLevelWhole, in halves if there is a lens, and the two
/// sample counts.
std::vector<std::string> LevelPassChannels(Level level, bool lens = false);

/// The channels that a geometry unit has for a level that some sub-sample has reached: kLevelFeatures.
std::vector<std::string> LevelFeatureChannels(Level level);

/// The channels that a pass unit has besides if the background is transparent.
inline constexpr std::array<std::string_view, 6> kMatte = {
    kOpacity, kCatcher, kCatcherLight[0], kCatcherLight[1], kCatcherShadow[0], kCatcherShadow[1]};

/// The channels of an edge set, see EdgedImage.
std::vector<std::string> EdgeChannels();

/// The channels of a list of fragments, see EdgedImage, with the layers of kFragmentHalved and kFragmentWhole
/// for which `has` is true. None if it has no light of kFragmentHalved: such fragments would tell nothing.
std::vector<std::string> FragmentChannels(absl::FunctionRef<bool(std::string_view layer)> has);
/// The same with all layers.
std::vector<std::string> FragmentChannels();

}  // namespace lumifold::layers
