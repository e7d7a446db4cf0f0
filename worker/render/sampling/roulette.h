#pragma once

#include <algorithm>

namespace lumifold::render {

/// Russian roulette: which paths go on from a vertex. Those that do count for those that do not, so the
/// picture has the same mean with any rule; noise and time differ. Sources: Arvo & Kirk 1990; Rath et al.
/// 2022, EARS (the rule by a path's throughput that costs the least for its noise).
struct Roulette {
  /// From the first bounce on, a path of throughput t goes on with probability t * percent / 100. 0: with
  /// probability t from the second bounce on, the rule for scenes of which nothing is known.
  int percent = 0;

  /// Probability with which a path goes on from vertex number `vertex`, the camera's surface being 0.
  /// `throughput` estimates that of the path after the next step; its greatest channel.
  float Survival(int vertex, float throughput) const {
    const float scale = Scale(vertex);
    return scale > 0 ? std::min(1.0f, throughput * scale * Unit()) : 1.0f;
  }
  /// Both times the throughput are the probability; 0: the path goes on.
  float Scale(int vertex) const {
    if (percent == 0) return vertex >= 2 ? 1.0f : 0.0f;
    return vertex >= 1 ? static_cast<float>(percent) : 0.0f;
  }
  float Unit() const { return percent == 0 ? 1.0f : 0.01f; }

  friend bool operator==(const Roulette&, const Roulette&) = default;
};

}  // namespace lumifold::render
