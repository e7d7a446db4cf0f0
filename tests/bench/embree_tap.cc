#include "tests/bench/embree_tap.h"

#include <x86intrin.h>

#include <atomic>

#include "filter/image/check.h"

// The linker sends every call of rtcX to __wrap_rtcX and every call of __real_rtcX to Embree.
// NOLINTBEGIN(bugprone-reserved-identifier): the linker chose these names.
extern "C" {
void __real_rtcIntersect1(RTCScene scene, RTCIntersectContext* context, RTCRayHit* query);
void __real_rtcOccluded1(RTCScene scene, RTCIntersectContext* context, RTCRay* query);
void __real_rtcIntersect8(const int* valid, RTCScene scene, RTCIntersectContext* context, RTCRayHit8* query);
void __real_rtcOccluded8(const int* valid, RTCScene scene, RTCIntersectContext* context, RTCRay8* query);
RTCDevice __real_rtcNewDevice(const char* config);
void __wrap_rtcIntersect1(RTCScene scene, RTCIntersectContext* context, RTCRayHit* query);
void __wrap_rtcOccluded1(RTCScene scene, RTCIntersectContext* context, RTCRay* query);
void __wrap_rtcIntersect8(const int* valid, RTCScene scene, RTCIntersectContext* context, RTCRayHit8* query);
void __wrap_rtcOccluded8(const int* valid, RTCScene scene, RTCIntersectContext* context, RTCRay8* query);
RTCDevice __wrap_rtcNewDevice(const char* config);
}

namespace lumifold::bench {
namespace {

/// What the calls of one thread are put to.
struct Tap {
  RayLog* log = nullptr;
  bool counts_ticks = false;
  int64_t ticks_inside = 0;

  bool IsOpen() const { return log != nullptr || counts_ticks; }
};

thread_local Tap tap;
std::atomic<int64_t> embree_bytes = 0;

int64_t Ticks() { return static_cast<int64_t>(__rdtsc()); }

bool CountBytes(void*, ssize_t bytes, bool) {
  embree_bytes += bytes;
  return true;
}

TracedRay Traced(const RTCRay& ray, bool occlusion) {
  return {
      {ray.org_x, ray.org_y, ray.org_z}, ray.tnear, {ray.dir_x, ray.dir_y, ray.dir_z}, ray.tfar, occlusion};
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
    ray.tfar = packet.tfar[i];
    Keep(scene, ray, occlusion);
  }
}

bool HasHit(const RTCRayHit& query) { return query.hit.geomID != RTC_INVALID_GEOMETRY_ID; }
bool IsOccluded(const RTCRay& query) { return query.tfar < 0; }

}  // namespace

ScopedRayLog::ScopedRayLog(RayLog* log) { tap.log = log; }
ScopedRayLog::~ScopedRayLog() { tap.log = nullptr; }

ScopedTickCount::ScopedTickCount() : start_(Ticks()) {
  tap.ticks_inside = 0;
  tap.counts_ticks = true;
}
ScopedTickCount::~ScopedTickCount() { tap.counts_ticks = false; }
int64_t ScopedTickCount::inside() const { return tap.ticks_inside; }
int64_t ScopedTickCount::total() const { return Ticks() - start_; }

int64_t Replay(const RayLog& log) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  int64_t hits = 0;
  for (const TracedRay& traced : log.rays) {
    if (traced.occlusion) {
      RTCRay query = RayOf(traced);
      __real_rtcOccluded1(log.scene, &context, &query);
      hits += IsOccluded(query);
    } else {
      RTCRayHit query = {RayOf(traced), {}};
      query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
      query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
      __real_rtcIntersect1(log.scene, &context, &query);
      hits += HasHit(query);
    }
  }
  return hits;
}

int64_t EmbreeBytes() { return embree_bytes; }

}  // namespace lumifold::bench

void __wrap_rtcIntersect1(RTCScene scene, RTCIntersectContext* context, RTCRayHit* query) {
  using lumifold::bench::HasHit;
  using lumifold::bench::Keep;
  using lumifold::bench::tap;
  using lumifold::bench::Ticks;
  if (!tap.IsOpen()) return __real_rtcIntersect1(scene, context, query);
  if (tap.log != nullptr) Keep(scene, query->ray, false);
  const int64_t start = Ticks();
  __real_rtcIntersect1(scene, context, query);
  tap.ticks_inside += Ticks() - start;
  if (tap.log != nullptr) tap.log->hits += HasHit(*query);
}

void __wrap_rtcOccluded1(RTCScene scene, RTCIntersectContext* context, RTCRay* query) {
  using lumifold::bench::IsOccluded;
  using lumifold::bench::Keep;
  using lumifold::bench::tap;
  using lumifold::bench::Ticks;
  if (!tap.IsOpen()) return __real_rtcOccluded1(scene, context, query);
  if (tap.log != nullptr) Keep(scene, *query, true);
  const int64_t start = Ticks();
  __real_rtcOccluded1(scene, context, query);
  tap.ticks_inside += Ticks() - start;
  if (tap.log != nullptr) tap.log->hits += IsOccluded(*query);
}

void __wrap_rtcIntersect8(const int* valid, RTCScene scene, RTCIntersectContext* context, RTCRayHit8* query) {
  using namespace lumifold::bench;
  if (!tap.IsOpen()) return __real_rtcIntersect8(valid, scene, context, query);
  if (tap.log != nullptr) KeepPacket(valid, scene, query->ray, false);
  const int64_t start = Ticks();
  __real_rtcIntersect8(valid, scene, context, query);
  tap.ticks_inside += Ticks() - start;
  if (tap.log == nullptr) return;
  for (int i = 0; i < kPacket; ++i)
    tap.log->hits += valid[i] != 0 && query->hit.geomID[i] != RTC_INVALID_GEOMETRY_ID;
}

void __wrap_rtcOccluded8(const int* valid, RTCScene scene, RTCIntersectContext* context, RTCRay8* query) {
  using namespace lumifold::bench;
  if (!tap.IsOpen()) return __real_rtcOccluded8(valid, scene, context, query);
  if (tap.log != nullptr) KeepPacket(valid, scene, *query, true);
  const int64_t start = Ticks();
  __real_rtcOccluded8(valid, scene, context, query);
  tap.ticks_inside += Ticks() - start;
  if (tap.log == nullptr) return;
  for (int i = 0; i < kPacket; ++i) tap.log->hits += valid[i] != 0 && query->tfar[i] < 0;
}

RTCDevice __wrap_rtcNewDevice(const char* config) {
  const RTCDevice device = __real_rtcNewDevice(config);
  if (device != nullptr) rtcSetDeviceMemoryMonitorFunction(device, lumifold::bench::CountBytes, nullptr);
  return device;
}
// NOLINTEND(bugprone-reserved-identifier)
