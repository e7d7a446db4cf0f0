#include "tests/bench/embree_tap.h"

#include <atomic>
#include <chrono>

#include "filter/image/check.h"
#include "worker/render/tracing/embree_api.h"

// The linker sends every call of rtcX to __wrap_rtcX and every call of __real_rtcX to Embree. Versions 3 and
// 4 differ in the order of the arguments and in what a query's context is.
#if LUMIFOLD_EMBREE_MAJOR == 3
#define LUMIFOLD_INTERSECT(query) RTCIntersectContext *context, query
#define LUMIFOLD_OCCLUDED(query) RTCIntersectContext *context, query
#define LUMIFOLD_PASS context, query
#else
#define LUMIFOLD_INTERSECT(query) query, RTCIntersectArguments* context
#define LUMIFOLD_OCCLUDED(query) query, RTCOccludedArguments* context
#define LUMIFOLD_PASS query, context
#endif
// NOLINTBEGIN(bugprone-reserved-identifier,clang-diagnostic-reserved-identifier): the linker chose these names.
extern "C" {
void __real_rtcIntersect1(RTCScene scene, LUMIFOLD_INTERSECT(RTCRayHit* query));
void __real_rtcOccluded1(RTCScene scene, LUMIFOLD_OCCLUDED(RTCRay* query));
void __real_rtcIntersect8(const int* valid, RTCScene scene, LUMIFOLD_INTERSECT(RTCRayHit8* query));
void __real_rtcOccluded8(const int* valid, RTCScene scene, LUMIFOLD_OCCLUDED(RTCRay8* query));
RTCDevice __real_rtcNewDevice(const char* config);
void __wrap_rtcIntersect1(RTCScene scene, LUMIFOLD_INTERSECT(RTCRayHit* query));
void __wrap_rtcOccluded1(RTCScene scene, LUMIFOLD_OCCLUDED(RTCRay* query));
void __wrap_rtcIntersect8(const int* valid, RTCScene scene, LUMIFOLD_INTERSECT(RTCRayHit8* query));
void __wrap_rtcOccluded8(const int* valid, RTCScene scene, LUMIFOLD_OCCLUDED(RTCRay8* query));
RTCDevice __wrap_rtcNewDevice(const char* config);
}

namespace lumifold::bench {
namespace {

/// What the calls of one thread are put to.
struct Tap {
  RayLog* log = nullptr;
  bool is_timed = false;
  int64_t ns_inside = 0;
};

thread_local Tap tap;
std::atomic<int64_t> embree_bytes = 0;

int64_t NowNs() { return std::chrono::steady_clock::now().time_since_epoch() / std::chrono::nanoseconds(1); }

bool CountBytes(void*, ssize_t bytes, bool) {
  embree_bytes += bytes;
  return true;
}

TracedRay Traced(const RTCRay& ray, bool occlusion) {
  return {{ray.org_x, ray.org_y, ray.org_z},
          ray.tnear,
          {ray.dir_x, ray.dir_y, ray.dir_z},
          ray.time,
          ray.tfar,
          occlusion};
}

RTCRay RayOf(const TracedRay& traced) {
  RTCRay ray = {};
  ray.org_x = traced.origin[0];
  ray.org_y = traced.origin[1];
  ray.org_z = traced.origin[2];
  ray.tnear = traced.near_distance;
  ray.dir_x = traced.direction[0];
  ray.dir_y = traced.direction[1];
  ray.dir_z = traced.direction[2];
  ray.time = traced.time;
  ray.tfar = traced.far_distance;
  ray.mask = ~0u;
  return ray;
}

void Keep(RTCScene scene, const RTCRay& ray, bool occlusion) {
  LUMIFOLD_CHECK(tap.log->scene == nullptr || tap.log->scene == scene);
  tap.log->scene = scene;
  tap.log->rays.push_back(Traced(ray, occlusion));
}

constexpr int kPacket = 8;

/// Keeps the rays of a packet one by one.
void KeepPacket(const int* valid, RTCScene scene, const RTCRay8& packet, bool occlusion) {
  for (int i = 0; i < kPacket; ++i) {
    if (valid[i] == 0) continue;
    RTCRay ray = {};
    ray.org_x = packet.org_x[i];
    ray.org_y = packet.org_y[i];
    ray.org_z = packet.org_z[i];
    ray.tnear = packet.tnear[i];
    ray.dir_x = packet.dir_x[i];
    ray.dir_y = packet.dir_y[i];
    ray.dir_z = packet.dir_z[i];
    ray.time = packet.time[i];
    ray.tfar = packet.tfar[i];
    Keep(scene, ray, occlusion);
  }
}

/// Calls Embree, and adds the time it takes where the thread's calls are timed.
template <typename Call>
void Timed(Call call) {
  if (!tap.is_timed) return call();
  const int64_t start_ns = NowNs();
  call();
  tap.ns_inside += NowNs() - start_ns;
}

bool HasHit(const RTCRayHit& query) { return query.hit.geomID != RTC_INVALID_GEOMETRY_ID; }
bool IsOccluded(const RTCRay& query) { return query.tfar < 0; }

}  // namespace

ScopedRayLog::ScopedRayLog(RayLog* log) { tap.log = log; }
ScopedRayLog::~ScopedRayLog() { tap.log = nullptr; }

ScopedEmbreeTime::ScopedEmbreeTime() : start_ns_(NowNs()) {
  tap.ns_inside = 0;
  tap.is_timed = true;
}
ScopedEmbreeTime::~ScopedEmbreeTime() { tap.is_timed = false; }
int64_t ScopedEmbreeTime::inside_ns() const { return tap.ns_inside; }
int64_t ScopedEmbreeTime::total_ns() const { return NowNs() - start_ns_; }

int64_t Replay(const RayLog& log) {
  render::embree::Context context(/*is_coherent=*/false);
  int64_t hits = 0;
  for (const TracedRay& traced : log.rays) {
    if (traced.occlusion) {
      RTCRay query = RayOf(traced);
      render::embree::Occluded1(log.scene, &context, &query);
      hits += IsOccluded(query);
    } else {
      RTCRayHit query = {RayOf(traced), {}};
      query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
      query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
      render::embree::Intersect1(log.scene, &context, &query);
      hits += HasHit(query);
    }
  }
  return hits;
}

int64_t EmbreeBytes() { return embree_bytes; }

}  // namespace lumifold::bench

void __wrap_rtcIntersect1(RTCScene scene, LUMIFOLD_INTERSECT(RTCRayHit* query)) {
  namespace bench = lumifold::bench;
  if (bench::tap.log != nullptr) bench::Keep(scene, query->ray, false);
  bench::Timed([&] { __real_rtcIntersect1(scene, LUMIFOLD_PASS); });
  if (bench::tap.log != nullptr) bench::tap.log->hits += bench::HasHit(*query);
}

void __wrap_rtcOccluded1(RTCScene scene, LUMIFOLD_OCCLUDED(RTCRay* query)) {
  namespace bench = lumifold::bench;
  if (bench::tap.log != nullptr) bench::Keep(scene, *query, true);
  bench::Timed([&] { __real_rtcOccluded1(scene, LUMIFOLD_PASS); });
  if (bench::tap.log != nullptr) bench::tap.log->hits += bench::IsOccluded(*query);
}

void __wrap_rtcIntersect8(const int* valid, RTCScene scene, LUMIFOLD_INTERSECT(RTCRayHit8* query)) {
  namespace bench = lumifold::bench;
  if (bench::tap.log != nullptr) bench::KeepPacket(valid, scene, query->ray, false);
  bench::Timed([&] { __real_rtcIntersect8(valid, scene, LUMIFOLD_PASS); });
  if (bench::tap.log == nullptr) return;
  for (int i = 0; i < bench::kPacket; ++i)
    bench::tap.log->hits += valid[i] != 0 && query->hit.geomID[i] != RTC_INVALID_GEOMETRY_ID;
}

void __wrap_rtcOccluded8(const int* valid, RTCScene scene, LUMIFOLD_OCCLUDED(RTCRay8* query)) {
  namespace bench = lumifold::bench;
  if (bench::tap.log != nullptr) bench::KeepPacket(valid, scene, *query, true);
  bench::Timed([&] { __real_rtcOccluded8(valid, scene, LUMIFOLD_PASS); });
  if (bench::tap.log == nullptr) return;
  for (int i = 0; i < bench::kPacket; ++i) bench::tap.log->hits += valid[i] != 0 && query->tfar[i] < 0;
}

RTCDevice __wrap_rtcNewDevice(const char* config) {
  const RTCDevice device = __real_rtcNewDevice(config);
  if (device != nullptr) rtcSetDeviceMemoryMonitorFunction(device, lumifold::bench::CountBytes, nullptr);
  return device;
}
// NOLINTEND(bugprone-reserved-identifier,clang-diagnostic-reserved-identifier)
