#pragma once

#include <string>
#include <string_view>

namespace lumifold::charts {

/// Whether a scene at this size was looked at while parameters of the default method were chosen, at any seed
/// and sample count. Every other scene or size is judged: its figures played no part in the choice.
bool IsTuning(std::string_view scene, int width, int height);

/// "tuning" or "judged", for a column of a table.
std::string SetName(std::string_view scene, int width, int height);

/// The scene with its set, for a heading: "atrium (judged)".
std::string SceneHeading(std::string_view scene, int width, int height);

}  // namespace lumifold::charts
