#include "tests/charts/tuning_set.h"

#include <algorithm>
#include <array>
#include <utility>

#include "absl/strings/str_cat.h"

namespace lumifold::charts {
namespace {

constexpr std::array<std::string_view, 6> kTuningScenes = {
    "cornell-box", "meeting-room", "bedroom", "meeting-room-lens", "bedroom-lens", "chess-board-lens"};
constexpr std::array<std::pair<int, int>, 4> kTuningSizes = {
    {{256, 192}, {512, 384}, {512, 512}, {1024, 768}}};

}  // namespace

bool IsTuning(std::string_view scene, int width, int height) {
  const bool has_scene = std::find(kTuningScenes.begin(), kTuningScenes.end(), scene) != kTuningScenes.end();
  const bool has_size =
      std::find(kTuningSizes.begin(), kTuningSizes.end(), std::pair(width, height)) != kTuningSizes.end();
  return has_scene && has_size;
}

std::string SetName(std::string_view scene, int width, int height) {
  return IsTuning(scene, width, height) ? "tuning" : "judged";
}

std::string SceneHeading(std::string_view scene, int width, int height) {
  return absl::StrCat(std::string(scene), " (", SetName(scene, width, height), ")");
}

}  // namespace lumifold::charts
