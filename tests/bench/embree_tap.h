#pragma once

#include <cstdint>
#include <vector>

#include "worker/render/tracing/embree_api.h"

/// Listens to what the renderer asks of Embree, in programs that link lumifold_embree_tap. The renderer knows nothing of it; a thread that is not listened to pays one branch a ray.
namespace lumifold::bench {

/// A ray as it was handed to rtcIntersect1, or to rtcOccluded1 where `occlusion`, or in a packet to
/// rtcIntersect8 or rtcOccluded8.
struct TracedRay {
  float origin[3];
  float near_distance;
  float direction[3];
  float time;
  float far_distance;
  bool occlusion;
};

/// What one thread asked of one Embree scene.
struct RayLog {
  RTCScene scene = nullptr;
  std::vector<TracedRay> rays;  // in the order they were asked
  int64_t hits = 0;             // rays that met something
};

/// Keeps this thread's rays in `log` until it goes out of scope. All of them must be of one scene.
class ScopedRayLog {
 public:
  explicit ScopedRayLog(RayLog* log);
  ~ScopedRayLog();
};

/// Measures how much of its time this thread spends inside Embree, until it goes out of scope.
class ScopedEmbreeTime {
 public:
  ScopedEmbreeTime();
  ~ScopedEmbreeTime();
  int64_t inside_ns() const;
  /// Time since construction.
  int64_t total_ns() const;

 private:
  int64_t start_ns_;
};

/// Asks Embree the rays of `log` once more, each by itself, and nothing else, and gives how many met
/// something.
int64_t Replay(const RayLog& log);

/// Bytes all Embree devices of this process hold: trees, and the copies they keep of vertices and indices.
int64_t EmbreeBytes();

}  // namespace lumifold::bench
