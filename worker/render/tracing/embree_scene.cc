#include "worker/render/tracing/embree_scene.h"

#include <algorithm>
#include <cstring>
#include <string>
#include <tuple>
#include <vector>

#include "absl/strings/str_cat.h"
#include "filter/image/mix_bits.h"
#include "filter/image/parallel.h"
#include "worker/render/materials/opacity.h"
#include "worker/render/tracing/embree_api.h"
#include "worker/render/tracing/processor.h"
#include "worker/scene/out_of_memory.h"

namespace lumifold::render {
namespace {

using scene::Affine;
using scene::Vec3;

struct Release {
  void operator()(RTCDevice device) const { rtcReleaseDevice(device); }
  void operator()(RTCScene scene) const { rtcReleaseScene(scene); }
  void operator()(RTCGeometry geometry) const { rtcReleaseGeometry(geometry); }
};
using Device = std::unique_ptr<RTCDeviceTy, Release>;
using SceneHandle = std::unique_ptr<RTCSceneTy, Release>;
using Geometry = std::unique_ptr<RTCGeometryTy, Release>;

/// A ray's record begins as Embree's ray does.
RTCRay EmbreeRay(const Ray& ray) {
  RTCRay r;
  static_assert(offsetof(RayRecord, max_distance) == offsetof(RTCRay, tfar));
  std::memcpy(&r, static_cast<const RayRecord*>(&ray), offsetof(RTCRay, tfar) + sizeof(r.tfar));
  r.mask = ~0u;
  r.id = 0;
  r.flags = 0;
  return r;
}

/// A packet of rays in Embree's layout for packets of 8.
static_assert(EmbreeScene::kPacket == 8);
struct alignas(32) Packet {
  int valid[EmbreeScene::kPacket];
  RTCRayHit8 query;

  explicit Packet(std::span<const Ray> rays) {
    for (size_t i = 0; i < EmbreeScene::kPacket; ++i) {
      valid[i] = i < rays.size() ? -1 : 0;
      Set(i, rays[i < rays.size() ? i : 0]);
    }
  }

 private:
  void Set(size_t i, const Ray& ray) {
    query.ray.org_x[i] = ray.origin.x;
    query.ray.org_y[i] = ray.origin.y;
    query.ray.org_z[i] = ray.origin.z;
    query.ray.tnear[i] = ray.min_distance;
    query.ray.dir_x[i] = ray.direction.x;
    query.ray.dir_y[i] = ray.direction.y;
    query.ray.dir_z[i] = ray.direction.z;
    query.ray.time[i] = ray.time;
    query.ray.tfar[i] = ray.max_distance;
    query.ray.mask[i] = ~0u;
    query.ray.id[i] = static_cast<unsigned>(i);
    query.ray.flags[i] = 0;
    query.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
    query.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
  }
};

/// What is needed to convert Embree's hits.
struct HitContext {
  const scene::Scene* scene;
  std::vector<char> is_mirrored;  // of each instance

  explicit HitContext(const scene::Scene& s) : scene(&s) {
    for (const scene::Instance& instance : s.instances)
      is_mirrored.push_back(instance.world_from_object.Determinant() < 0);
  }
};

/// Embree's hit in the scene's terms. For a mesh in world space the geometry's id is the instance.
void SetHit(const HitContext& hit_context, const RTCHit& embree, float distance, Hit* hit) {
  const bool instanced = embree.instID[0] != RTC_INVALID_GEOMETRY_ID;
  hit->instance = static_cast<int>(instanced ? embree.instID[0] : embree.geomID);
  hit->triangle = embree.primID;
  hit->u = embree.u;
  hit->v = embree.v;
  hit->distance = distance;
  const Vec3 normal = {embree.Ng_x, embree.Ng_y, embree.Ng_z};
  if (instanced) {
    hit->face_normal = hit_context.scene->instances[hit->instance].world_from_object.Normal(normal);
  } else {
    // a mirroring transform has reversed the winding
    hit->face_normal = hit_context.is_mirrored[hit->instance] != 0 ? -normal : normal;
  }
}

Hit HitOf(const HitContext& hit_context, const RTCHit& embree, float distance) {
  Hit hit;
  SetHit(hit_context, embree, distance, &hit);
  return hit;
}

thread_local int64_t rays_of_thread = 0;

/// What the filter functions of one query need. They receive the address of its first member.
struct QueryContext {
  embree::Context embree;
  const HitContext* hit_context;
  std::span<const Ray> rays;        // indexed by Embree's ray id
  TransparentHits* hits = nullptr;  // if set, collects all hits, and no hit ends the ray
  const Hit* last = nullptr;        // if set, only hits after this one are collected

  QueryContext(const HitContext* h, std::span<const Ray> r) : embree(r.size() > 1), hit_context(h), rays(r) {
    rays_of_thread += static_cast<int64_t>(rays.size());
  }
};

/// A hit that a filter function accepts or rejects, and its ray's random key.
struct Candidate {
  const QueryContext& context;
  uint64_t random_key;
  Hit hit;
};

/// Rejects the hits for which rejects(Candidate) is true: the ray continues behind them.
template <typename Rejects>
void RejectWhere(const RTCFilterFunctionNArguments* arguments, Rejects rejects) {
  const auto& context = *reinterpret_cast<const QueryContext*>(arguments->context);
  const unsigned count = arguments->N;
  for (unsigned i = 0; i < count; ++i) {
    if (arguments->valid[i] == 0) continue;
    const Hit hit = HitOf(*context.hit_context, rtcGetHitFromHitN(arguments->hit, count, i),
                          RTCRayN_tfar(arguments->ray, count, i));
    const uint64_t random_key = context.rays[RTCRayN_id(arguments->ray, count, i)].random_key;
    if (rejects(Candidate{context, random_key, hit})) arguments->valid[i] = 0;
  }
}

float OpacityOf(const scene::Scene& scene, const Hit& hit) {
  return OpacityAt(scene, scene.meshes[scene.instances[hit.instance].mesh], hit.triangle, hit.u, hit.v);
}

/// A deterministic function of the ray's random key and the triangle, because Embree may call it twice.
bool IsAccepted(const Candidate& candidate) {
  const Hit& hit = candidate.hit;
  const float opacity = OpacityOf(*candidate.context.hit_context->scene, hit);
  if (opacity >= 1 || opacity <= 0) return opacity >= 1;
  const uint64_t triangle = (static_cast<uint64_t>(static_cast<uint32_t>(hit.instance)) << 32) | hit.triangle;
  const uint64_t bits = MixBits(MixBits(candidate.random_key) ^ MixBits(~triangle));
  return static_cast<float>(bits >> 40) * 0x1p-24f < opacity;
}

bool LiesBefore(const Hit& a, const Hit& b) {
  return std::tie(a.distance, a.instance, a.triangle) < std::tie(b.distance, b.instance, b.triangle);
}

/// Keeps the nearest hits in order, without duplicates.
void Insert(const Hit& hit, TransparentHits* hits) {
  Hit* const begin = hits->hits.data();
  Hit* const end = begin + hits->count;
  Hit* const position = std::lower_bound(begin, end, hit, LiesBefore);
  if (position == begin + TransparentHits::kMaxHits || (position != end && !LiesBefore(hit, *position)))
    return;
  const bool full = hits->count == TransparentHits::kMaxHits;
  std::move_backward(position, full ? end - 1 : end, full ? end : end + 1);
  *position = hit;
  if (!full) ++hits->count;
}

void AcceptOrCollect(const RTCFilterFunctionNArguments* arguments) {
  RejectWhere(arguments, [](const Candidate& candidate) {
    const QueryContext& context = candidate.context;
    if (context.hits == nullptr) return !IsAccepted(candidate);
    if (context.last == nullptr || LiesBefore(*context.last, candidate.hit))
      Insert(candidate.hit, context.hits);
    return true;
  });
}

void RejectCutOut(const RTCFilterFunctionNArguments* arguments) {
  RejectWhere(arguments, [](const Candidate& candidate) {
    return OpacityOf(*candidate.context.hit_context->scene, candidate.hit) <= 0;
  });
}

void RejectAll(const RTCFilterFunctionNArguments* arguments) {
  RejectWhere(arguments, [](const Candidate&) { return true; });
}

class EmbreeSceneImpl final : public EmbreeScene {
 public:
  Hit Intersect(const Ray& ray) const override {
    QueryContext context(&hit_context_, {&ray, 1});
    RTCRayHit query = {EmbreeRay(ray), {}};
    Trace(world_.get(), &query, &context);
    if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return {};
    return HitOf(hit_context_, query.hit, query.ray.tfar);
  }

  void IntersectEach(std::span<const Ray* const> rays, std::span<Hit> hits) const override {
    QueryContext context(&hit_context_, {});
    rays_of_thread += static_cast<int64_t>(rays.size());
    for (size_t i = 0; i < rays.size(); ++i) {
      context.rays = {rays[i], 1};
      RTCRayHit query = {EmbreeRay(*rays[i]), {}};
      Trace(world_.get(), &query, &context);
      if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) {
        hits[i].instance = scene::kNone;
      } else {
        SetHit(hit_context_, query.hit, query.ray.tfar, &hits[i]);
      }
    }
  }

  bool IsOccluded(const Ray& ray) const override {
    QueryContext context(&hit_context_, {&ray, 1});
    RTCRay query = EmbreeRay(ray);
    embree::Occluded1(world_.get(), &context.embree, &query);
    return query.tfar < 0;
  }

  void IntersectTogether(std::span<const Ray> rays, std::span<Hit> hits) const override {
    QueryContext context(&hit_context_, rays);
    Packet packet(rays);
    embree::Intersect8(packet.valid, world_.get(), &context.embree, &packet.query);
    for (unsigned i = 0; i < rays.size(); ++i) {
      hits[i] =
          packet.query.hit.geomID[i] == RTC_INVALID_GEOMETRY_ID
              ? Hit{}
              : HitOf(hit_context_, rtcGetHitFromHitN(reinterpret_cast<RTCHitN*>(&packet.query.hit), 8, i),
                      packet.query.ray.tfar[i]);
    }
  }

  void AreOccludedTogether(std::span<const Ray> rays, std::span<bool> occluded) const override {
    QueryContext context(&hit_context_, rays);
    Packet packet(rays);
    embree::Occluded8(packet.valid, world_.get(), &context.embree, &packet.query.ray);
    for (size_t i = 0; i < rays.size(); ++i) occluded[i] = packet.query.ray.tfar[i] < 0;
  }

  TransparentHits FindTransparentHits(const Ray& ray, const Hit* last) const override {
    constexpr float kBeforeLast = 1.0f - 0x1p-20f;  // Embree excludes hits exactly at tnear
    TransparentHits hits;
    QueryContext context(&hit_context_, {&ray, 1});
    context.hits = &hits;
    context.last = last;
    RTCRayHit query = {EmbreeRay(ray), {}};
    if (last != nullptr) query.ray.tnear = last->distance * kBeforeLast;
    Trace(transparent_.get(), &query, &context);
    return hits;
  }

  explicit EmbreeSceneImpl(const scene::Scene& scene) : hit_context_(scene) {}

  absl::Status Build(const OpacitySource& opacity, TaskPool& builders) {
    const scene::Scene& scene = *hit_context_.scene;
#if defined(__x86_64__)
    const std::string config = absl::StrCat("set_affinity=0,isa=", TracingInstructionSet());
#else
    const std::string config = "set_affinity=0";  // there is one instruction set to choose from
#endif
    device_.reset(rtcNewDevice(config.c_str()));
    if (device_ == nullptr) return DeviceError();
    std::vector<int> uses(scene.meshes.size(), 0);
    for (const scene::Instance& instance : scene.instances) ++uses[instance.mesh];
    prototypes_.resize(scene.meshes.size());
    world_ = NewScene();
    for (size_t i = 0; i < scene.instances.size(); ++i) {
      const scene::Instance& instance = scene.instances[i];
      const scene::Mesh& mesh = scene.meshes[instance.mesh];
      if (mesh.triangles.empty()) continue;
      const OpacityClass opacity_class = opacity(scene, mesh);
      const Geometry geometry = uses[instance.mesh] == 1
                                    ? NewTriangles(mesh, instance.world_from_object, opacity_class)
                                    : NewInstance(mesh, instance, opacity_class, builders);
      if (geometry == nullptr) break;
      rtcCommitGeometry(geometry.get());
      rtcAttachGeometryByID(world_.get(), geometry.get(), static_cast<unsigned>(i));
      if (opacity_class == OpacityClass::kTransparent)
        AddTransparent(geometry.get(), static_cast<unsigned>(i));
    }
    if (has_transparent_) Commit(transparent_.get(), builders);
    Commit(world_.get(), builders);
    return DeviceError();
  }

 private:
  /// Builds the acceleration structure on the threads of `builders`, in whose arena of TBB the one task runs.
  /// (The device option "threads" would limit every TBB pool of the process while the device exists.)
  static void Commit(RTCScene scene, TaskPool& builders) {
    builders.Run(1, [scene](int64_t) { rtcCommitScene(scene); });
  }

  static void Trace(RTCScene scene, RTCRayHit* query, QueryContext* context) {
    query->hit.geomID = RTC_INVALID_GEOMETRY_ID;
    query->hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    embree::Intersect1(scene, &context->embree, query);
  }

  SceneHandle NewScene() const {
    SceneHandle handle(rtcNewScene(device_.get()));
    // Robust: closed surfaces have no cracks. Embree has no better tree for robust scenes than that of medium
    // quality (decision 34).
    rtcSetSceneFlags(handle.get(), RTC_SCENE_FLAG_ROBUST);
    rtcSetSceneBuildQuality(handle.get(), RTC_BUILD_QUALITY_MEDIUM);
    return handle;
  }

  /// Transparent surfaces are also in a scene of their own, in which FindTransparentHits() collects them.
  void AddTransparent(RTCGeometry geometry, unsigned id) {
    if (!has_transparent_) transparent_ = NewScene();
    has_transparent_ = true;
    rtcAttachGeometryByID(transparent_.get(), geometry, id);
  }

  /// Vertices are shared where they need no transform. Embree reads 16 bytes of each.
  static bool SetVertices(RTCGeometry geometry, const std::vector<Vec3>& positions, const Affine& to_world) {
    if (to_world == Affine{} && positions.capacity() > positions.size()) {
      rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, positions.data(), 0,
                                 sizeof(Vec3), positions.size());
      return true;
    }
    auto* const copies = static_cast<Vec3*>(rtcSetNewGeometryBuffer(
        geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(Vec3), positions.size()));
    if (copies == nullptr) return false;
    std::ranges::transform(positions, copies, [&](Vec3 p) { return to_world.Point(p); });
    return true;
  }

  Geometry NewTriangles(const scene::Mesh& mesh, const Affine& to_world, OpacityClass opacity_class) const {
    Geometry geometry(rtcNewGeometry(device_.get(), RTC_GEOMETRY_TYPE_TRIANGLE));
    if (!SetVertices(geometry.get(), mesh.positions, to_world)) return nullptr;
    rtcSetSharedGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                               mesh.triangles.data(), 0, 3 * sizeof(uint32_t), mesh.triangles.size() / 3);
    if (opacity_class != OpacityClass::kOpaque) {
      rtcSetGeometryIntersectFilterFunction(geometry.get(), AcceptOrCollect);
      rtcSetGeometryOccludedFilterFunction(
          geometry.get(), opacity_class == OpacityClass::kTransparent ? RejectAll : RejectCutOut);
    }
    return geometry;
  }

  Geometry NewInstance(const scene::Mesh& mesh, const scene::Instance& instance, OpacityClass opacity_class,
                       TaskPool& builders) {
    SceneHandle& prototype = prototypes_[instance.mesh];
    if (prototype == nullptr) {
      prototype = NewScene();
      const Geometry triangles = NewTriangles(mesh, Affine{}, opacity_class);
      if (triangles == nullptr) return nullptr;
      rtcCommitGeometry(triangles.get());
      rtcAttachGeometry(prototype.get(), triangles.get());
      Commit(prototype.get(), builders);
    }
    Geometry geometry(rtcNewGeometry(device_.get(), RTC_GEOMETRY_TYPE_INSTANCE));
    rtcSetGeometryInstancedScene(geometry.get(), prototype.get());
    rtcSetGeometryTransform(geometry.get(), 0, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, &instance.world_from_object);
    return geometry;
  }

  absl::Status DeviceError() const {
    switch (rtcGetDeviceError(device_.get())) {
      case RTC_ERROR_NONE:
        return absl::OkStatus();
      case RTC_ERROR_OUT_OF_MEMORY:
        return scene::OutOfMemory("the scene's acceleration structure");
      default:
        return absl::InternalError("Embree refused the scene's geometry");
    }
  }

  HitContext hit_context_;
  Device device_;  // released last
  std::vector<SceneHandle> prototypes_;
  SceneHandle world_;
  SceneHandle transparent_;
};

}  // namespace

const char* EmbreeName() { return RTC_VERSION_MAJOR == 3 ? "embree3" : "embree4"; }

int64_t RaysOfThread() { return rays_of_thread; }

absl::StatusOr<std::unique_ptr<EmbreeScene>> EmbreeScene::Create(const scene::Scene& scene,
                                                                 const OpacitySource& opacity,
                                                                 TaskPool* builders) {
  auto result = std::make_unique<EmbreeSceneImpl>(scene);
  const std::unique_ptr<TaskPool> this_thread = builders == nullptr ? MakeTaskPool(1) : nullptr;
  TaskPool& pool = builders == nullptr ? *this_thread : *builders;
  if (absl::Status status = result->Build(opacity, pool); !status.ok()) return status;
  return result;
}

}  // namespace lumifold::render
