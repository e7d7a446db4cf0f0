#pragma once

#include <array>
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "absl/types/span.h"
#include "filter/image/layers.h"

/// The names and values of a plan's decisions, the same in all programs: see docs/plan.md.
namespace lumifold::decisions {

struct Decision {
  std::string_view name;
  std::string_view governs;  // what obeys it
  /// The values it may have; 0 to 1 is a switch, "off" and "on".
  int least = 0;
  int most = 1;
  /// The value that models everything; of `bounces` that is the number that the job asks for.
  int full = 1;

  constexpr bool IsSwitch() const { return least == 0 && most == 1; }
};

inline constexpr std::string_view kBounces = "bounces";
inline constexpr std::string_view kLevels = "levels";
inline constexpr std::string_view kDirect = "direct";
inline constexpr std::string_view kIndirect = "indirect";
inline constexpr std::string_view kAlbedo = "albedo";
inline constexpr std::string_view kEmission = "emission";
inline constexpr std::string_view kGlossy = "glossy";
inline constexpr std::string_view kTileSize = "tile-size";
inline constexpr std::string_view kPassSamples = "pass-samples";
inline constexpr std::string_view kCostliestFirst = "costliest-first";

/// All decisions, in the order in which they are made.
inline constexpr std::array<Decision, 13> kAll = {{
    {kBounces, "paths", 0, 1024, 1024},
    {kLevels, "paths, layers, filter", 0, layers::kMaxDepth, layers::kMaxDepth},
    {kDirect, "layer D"},
    {kIndirect, "layer I"},
    {kAlbedo, "layer T"},
    {kEmission, "layer E"},
    {kGlossy, "layers G and S"},
    {"general-code", "paths"},
    {"emission-on-hits", "paths"},
    {"alpha-by-mode", "rays"},
    {kTileSize, "units", 8, 512, 32},
    {kPassSamples, "units", 0, 1 << 20, 0},  // 0: the coordinator's default
    {kCostliestFirst, "units", 0, 1, 0},
}};

/// Null for a name that does not exist.
const Decision* Find(std::string_view name);

/// "on", "off" or a number.
std::string ValueText(const Decision& decision, int value);

/// Values by name of decision.
using Values = std::map<std::string_view, int>;

/// Reads "NAME=VALUE" texts; the last one of a name counts.
/// Errors: kInvalidArgument for a decision that does not exist or cannot have that value, naming those that
/// can.
absl::StatusOr<Values> ParseForced(absl::Span<const std::string> forced);

}  // namespace lumifold::decisions
