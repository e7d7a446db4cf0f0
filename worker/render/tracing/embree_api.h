#pragma once

// The part of Embree's interface that changed between versions 3 and 4: how a query gets its context. CMake
// defines LUMIFOLD_EMBREE_MAJOR with the target lumifold_embree. For embree_scene.cc and the benchmarks that
// listen to it.
#if LUMIFOLD_EMBREE_MAJOR == 3
#include <embree3/rtcore.h>
#else
#include <embree4/rtcore.h>
#endif

namespace lumifold::render::embree {

#if LUMIFOLD_EMBREE_MAJOR == 3

/// The third argument of a query's filter functions points to its first member.
struct Context {
  RTCIntersectContext shared;

  explicit Context(bool is_coherent) {
    rtcInitIntersectContext(&shared);
    if (is_coherent) shared.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  }
};

inline void Intersect1(RTCScene scene, Context* context, RTCRayHit* query) {
  rtcIntersect1(scene, &context->shared, query);
}
inline void Occluded1(RTCScene scene, Context* context, RTCRay* query) {
  rtcOccluded1(scene, &context->shared, query);
}
inline void Intersect8(const int* valid, RTCScene scene, Context* context, RTCRayHit8* query) {
  rtcIntersect8(valid, scene, &context->shared, query);
}
inline void Occluded8(const int* valid, RTCScene scene, Context* context, RTCRay8* query) {
  rtcOccluded8(valid, scene, &context->shared, query);
}

#else

/// The third argument of a query's filter functions points to its first member.
struct Context {
  RTCRayQueryContext shared;
  RTCRayQueryFlags flags;

  explicit Context(bool is_coherent)
      : flags(is_coherent ? RTC_RAY_QUERY_FLAG_COHERENT : RTC_RAY_QUERY_FLAG_INCOHERENT) {
    rtcInitRayQueryContext(&shared);
  }
  RTCIntersectArguments IntersectArguments() {
    RTCIntersectArguments arguments;
    rtcInitIntersectArguments(&arguments);
    arguments.context = &shared;
    arguments.flags = flags;
    return arguments;
  }
  RTCOccludedArguments OccludedArguments() {
    RTCOccludedArguments arguments;
    rtcInitOccludedArguments(&arguments);
    arguments.context = &shared;
    arguments.flags = flags;
    return arguments;
  }
};

inline void Intersect1(RTCScene scene, Context* context, RTCRayHit* query) {
  RTCIntersectArguments arguments = context->IntersectArguments();
  rtcIntersect1(scene, query, &arguments);
}
inline void Occluded1(RTCScene scene, Context* context, RTCRay* query) {
  RTCOccludedArguments arguments = context->OccludedArguments();
  rtcOccluded1(scene, query, &arguments);
}
inline void Intersect8(const int* valid, RTCScene scene, Context* context, RTCRayHit8* query) {
  RTCIntersectArguments arguments = context->IntersectArguments();
  rtcIntersect8(valid, scene, query, &arguments);
}
inline void Occluded8(const int* valid, RTCScene scene, Context* context, RTCRay8* query) {
  RTCOccludedArguments arguments = context->OccludedArguments();
  rtcOccluded8(valid, scene, query, &arguments);
}

#endif

}  // namespace lumifold::render::embree
