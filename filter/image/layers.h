#pragma once

#include <array>
#include <string>
#include <string_view>

/// The names of channels, alike in units, films and OpenEXR files. A unit holds sums, a film and a file hold
/// means.
namespace lumifold::layers {

// Colour layers, each LAYER.R LAYER.G LAYER.B. The finished picture itself is plain R G B A.
inline constexpr std::string_view kBeauty;                       // no prefix
inline constexpr std::string_view kNoisy = "noisy";              // C, the path's whole radiance
inline constexpr std::string_view kDirect = "direct";            // D
inline constexpr std::string_view kIndirect = "indirect";        // I
inline constexpr std::string_view kAlbedo = "albedo";            // T
inline constexpr std::string_view kEmission = "emission";        // E
inline constexpr std::string_view kReflection1 = "reflection1";  // R, first level

// Single channels of the geometry unit. Mask is METHODS' validity: 1 where a surface with a diffuse lobe is
// seen.
inline constexpr std::string_view kNormalX = "N.X";
inline constexpr std::string_view kNormalY = "N.Y";
inline constexpr std::string_view kNormalZ = "N.Z";
inline constexpr std::string_view kPlanarDepth = "Z";        // along the view axis; 0 where nothing is hit
inline constexpr std::string_view kDistance = "distance.Z";  // along the ray; 0 where nothing is hit
inline constexpr std::string_view kObjectId = "id.Y";  // 1-based instance number; 0 where nothing is hit
inline constexpr std::string_view kMask = "mask.Y";    // fraction of samples with a valid surface
inline constexpr std::string_view kAlpha = "A";        // coverage: fraction of samples that hit anything

// Sample counts of the halves, per pixel.
inline constexpr std::string_view kSamplesA = "samples_a.Y";
inline constexpr std::string_view kSamplesB = "samples_b.Y";

/// The layers that are kept in two independent halves, in the order they are stored.
inline constexpr std::array<std::string_view, 4> kHalved = {kNoisy, kDirect, kIndirect, kReflection1};

/// "direct" -> "direct_a" / "direct_b".
inline std::string HalfA(std::string_view layer) { return std::string(layer) + "_a"; }
inline std::string HalfB(std::string_view layer) { return std::string(layer) + "_b"; }

/// "direct" -> direct.R direct.G direct.B; "" -> R G B.
inline std::array<std::string, 3> ColorChannels(std::string_view layer) {
  const std::string prefix = layer.empty() ? "" : std::string(layer) + ".";
  return {prefix + "R", prefix + "G", prefix + "B"};
}

}  // namespace lumifold::layers
