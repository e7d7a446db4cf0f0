#include "worker/render/embree_scene.h"

#include <embree3/rtcore.h>

#include <algorithm>
#include <string>
#include <tuple>
#include <vector>

#include "absl/strings/str_cat.h"
#include "filter/image/mix_bits.h"
#include "filter/image/parallel.h"
#include "worker/render/opacity.h"

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

RTCRay EmbreeRay(const Ray& ray) {
  RTCRay r = {};
  r.org_x = ray.origin.x;
  r.org_y = ray.origin.y;
  r.org_z = ray.origin.z;
  r.dir_x = ray.direction.x;
  r.dir_y = ray.direction.y;
  r.dir_z = ray.direction.z;
  r.tfar = ray.max_distance;
  r.mask = ~0u;
  return r;
}

/// Rays as Embree takes them together. Its own names for 8 are used as they stand.
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
    query.ray.tnear[i] = 0;
    query.ray.dir_x[i] = ray.direction.x;
    query.ray.dir_y[i] = ray.direction.y;
    query.ray.dir_z[i] = ray.direction.z;
    query.ray.time[i] = 0;
    query.ray.tfar[i] = ray.max_distance;
    query.ray.mask[i] = ~0u;
    query.ray.id[i] = static_cast<unsigned>(i);
    query.ray.flags[i] = 0;
    query.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
    query.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
  }
};

/// What hits are told apart by.
struct Places {
  const scene::Scene* scene;
  std::vector<char> is_mirrored;  // of each instance

  explicit Places(const scene::Scene& s) : scene(&s) {
    for (const scene::Instance& instance : s.instances)
      is_mirrored.push_back(instance.world_from_object.Determinant() < 0);
  }
};

/// A hit as the scene names it. At a baked mesh the instance is the geometry's id.
Hit HitOf(const Places& places, const RTCHit& embree, float distance) {
  const bool instanced = embree.instID[0] != RTC_INVALID_GEOMETRY_ID;
  Hit hit;
  hit.instance = static_cast<int>(instanced ? embree.instID[0] : embree.geomID);
  hit.triangle = embree.primID;
  hit.u = embree.u;
  hit.v = embree.v;
  hit.distance = distance;
  const Vec3 normal = {embree.Ng_x, embree.Ng_y, embree.Ng_z};
  if (instanced) {
    hit.face_normal = places.scene->instances[hit.instance].world_from_object.Normal(normal);
  } else {
    // a mirroring transform has turned the winding round
    hit.face_normal = places.is_mirrored[hit.instance] != 0 ? -normal : normal;
  }
  return hit;
}

/// What the filters of one query need; Embree hands them its first member's address.
struct QueryContext {
  RTCIntersectContext embree;
  const Places* places;
  std::span<const Ray> rays;  // a ray's id is its place here
  Veils* veils = nullptr;     // gathers all hits, of which none then ends the ray,
  const Hit* last = nullptr;  // beyond this one

  QueryContext(const Places* p, std::span<const Ray> r) : places(p), rays(r) {
    rtcInitIntersectContext(&embree);
    if (rays.size() > 1) embree.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  }
};

/// A hit that a filter is to judge, and its ray's chance.
struct Candidate {
  const QueryContext& context;
  uint64_t chance;
  Hit hit;
};

/// Takes away the hits that lie in what `passes(Candidate)`.
template <typename Passes>
void PassWhere(const RTCFilterFunctionNArguments* arguments, Passes passes) {
  const auto& context = *reinterpret_cast<const QueryContext*>(arguments->context);
  const unsigned count = arguments->N;
  for (unsigned i = 0; i < count; ++i) {
    if (arguments->valid[i] == 0) continue;
    const Hit hit = HitOf(*context.places, rtcGetHitFromHitN(arguments->hit, count, i),
                          RTCRayN_tfar(arguments->ray, count, i));
    const uint64_t chance = context.rays[RTCRayN_id(arguments->ray, count, i)].chance;
    if (passes(Candidate{context, chance, hit})) arguments->valid[i] = 0;
  }
}

float OpacityOf(const scene::Scene& scene, const Hit& hit) {
  return OpacityAt(scene, scene.meshes[scene.instances[hit.instance].mesh], hit.triangle, hit.u, hit.v);
}

/// The same answer whenever a ray of this chance asks about this triangle: Embree may ask twice.
bool IsMet(const Candidate& candidate) {
  const Hit& hit = candidate.hit;
  const float opacity = OpacityOf(*candidate.context.places->scene, hit);
  if (opacity >= 1 || opacity <= 0) return opacity >= 1;
  const uint64_t place = (static_cast<uint64_t>(static_cast<uint32_t>(hit.instance)) << 32) | hit.triangle;
  const uint64_t bits = MixBits(MixBits(candidate.chance) ^ MixBits(~place));
  return static_cast<float>(bits >> 40) * 0x1p-24f < opacity;
}

bool LiesBefore(const Hit& a, const Hit& b) {
  return std::tie(a.distance, a.instance, a.triangle) < std::tie(b.distance, b.instance, b.triangle);
}

/// Keeps the first of all that come, each once, in order.
void Insert(const Hit& hit, Veils* veils) {
  Hit* const begin = veils->hits.data();
  Hit* const end = begin + veils->count;
  Hit* const place = std::lower_bound(begin, end, hit, LiesBefore);
  if (place == begin + Veils::kMost || (place != end && !LiesBefore(hit, *place))) return;
  const bool full = veils->count == Veils::kMost;
  std::move_backward(place, full ? end - 1 : end, full ? end : end + 1);
  *place = hit;
  if (!full) ++veils->count;
}

void MeetOrGather(const RTCFilterFunctionNArguments* arguments) {
  PassWhere(arguments, [](const Candidate& candidate) {
    const QueryContext& context = candidate.context;
    if (context.veils == nullptr) return !IsMet(candidate);
    if (context.last == nullptr || LiesBefore(*context.last, candidate.hit))
      Insert(candidate.hit, context.veils);
    return true;
  });
}

void PassHoles(const RTCFilterFunctionNArguments* arguments) {
  PassWhere(arguments, [](const Candidate& candidate) {
    return OpacityOf(*candidate.context.places->scene, candidate.hit) <= 0;
  });
}

void PassAll(const RTCFilterFunctionNArguments* arguments) {
  PassWhere(arguments, [](const Candidate&) { return true; });
}

class EmbreeSceneImpl final : public EmbreeScene {
 public:
  Hit Intersect(const Ray& ray) const override {
    QueryContext context(&places_, {&ray, 1});
    RTCRayHit query = {EmbreeRay(ray), {}};
    Trace(world_.get(), &query, &context);
    if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return {};
    return HitOf(places_, query.hit, query.ray.tfar);
  }

  bool IsOccluded(const Ray& ray) const override {
    QueryContext context(&places_, {&ray, 1});
    RTCRay query = EmbreeRay(ray);
    rtcOccluded1(world_.get(), &context.embree, &query);
    return query.tfar < 0;
  }

  void IntersectTogether(std::span<const Ray> rays, std::span<Hit> hits) const override {
    QueryContext context(&places_, rays);
    Packet packet(rays);
    rtcIntersect8(packet.valid, world_.get(), &context.embree, &packet.query);
    for (unsigned i = 0; i < rays.size(); ++i) {
      hits[i] = packet.query.hit.geomID[i] == RTC_INVALID_GEOMETRY_ID
                    ? Hit{}
                    : HitOf(places_, rtcGetHitFromHitN(reinterpret_cast<RTCHitN*>(&packet.query.hit), 8, i),
                            packet.query.ray.tfar[i]);
    }
  }

  void AreOccludedTogether(std::span<const Ray> rays, std::span<bool> occluded) const override {
    QueryContext context(&places_, rays);
    Packet packet(rays);
    rtcOccluded8(packet.valid, world_.get(), &context.embree, &packet.query.ray);
    for (size_t i = 0; i < rays.size(); ++i) occluded[i] = packet.query.ray.tfar[i] < 0;
  }

  Veils VeilsOn(const Ray& ray, const Hit* last) const override {
    constexpr float kJustBefore = 1.0f - 0x1p-20f;  // Embree leaves out what lies exactly where a ray begins
    Veils veils;
    QueryContext context(&places_, {&ray, 1});
    context.veils = &veils;
    context.last = last;
    RTCRayHit query = {EmbreeRay(ray), {}};
    if (last != nullptr) query.ray.tnear = last->distance * kJustBefore;
    Trace(veils_.get(), &query, &context);
    return veils;
  }

  explicit EmbreeSceneImpl(const scene::Scene& scene) : places_(scene), builder_(MakeTaskPool(1)) {}

  absl::Status Build() {
    const scene::Scene& scene = *places_.scene;
    const std::string config = absl::StrCat("set_affinity=0,isa=", TracingInstructionSet());
    device_.reset(rtcNewDevice(config.c_str()));
    if (device_ == nullptr) return absl::InternalError("Embree: no device");
    std::vector<int> uses(scene.meshes.size(), 0);
    for (const scene::Instance& instance : scene.instances) ++uses[instance.mesh];
    prototypes_.resize(scene.meshes.size());
    world_ = NewScene();
    for (size_t i = 0; i < scene.instances.size(); ++i) {
      const scene::Instance& instance = scene.instances[i];
      const scene::Mesh& mesh = scene.meshes[instance.mesh];
      if (mesh.triangles.empty()) continue;
      const Openness openness = OpennessOf(scene, mesh);
      const Geometry geometry = uses[instance.mesh] == 1
                                    ? NewTriangles(mesh, instance.world_from_object, openness)
                                    : NewInstance(mesh, instance, openness);
      if (geometry == nullptr) break;
      rtcCommitGeometry(geometry.get());
      rtcAttachGeometryByID(world_.get(), geometry.get(), static_cast<unsigned>(i));
      if (openness == Openness::kVeil) AddVeil(geometry.get(), static_cast<unsigned>(i));
    }
    if (has_veils_) Commit(veils_.get());
    Commit(world_.get());
    return DeviceError();
  }

 private:
  /// Builds the tree on this thread. (The device's own "threads=1" would do so too, but for as long as the
  /// device lives it holds every TBB pool of the process to one thread.)
  void Commit(RTCScene scene) {
    builder_->Run(1, [scene](int64_t) { rtcCommitScene(scene); });
  }

  static void Trace(RTCScene scene, RTCRayHit* query, QueryContext* context) {
    query->hit.geomID = RTC_INVALID_GEOMETRY_ID;
    query->hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    rtcIntersect1(scene, &context->embree, query);
  }

  SceneHandle NewScene() const {
    SceneHandle handle(rtcNewScene(device_.get()));
    rtcSetSceneFlags(handle.get(), RTC_SCENE_FLAG_ROBUST);
    rtcSetSceneBuildQuality(handle.get(), RTC_BUILD_QUALITY_HIGH);
    return handle;
  }

  /// Veils are in a scene of their own as well, to be walked through one by one.
  void AddVeil(RTCGeometry geometry, unsigned id) {
    if (!has_veils_) veils_ = NewScene();
    has_veils_ = true;
    rtcAttachGeometryByID(veils_.get(), geometry, id);
  }

  Geometry NewTriangles(const scene::Mesh& mesh, const Affine& to_world, Openness openness) const {
    Geometry geometry(rtcNewGeometry(device_.get(), RTC_GEOMETRY_TYPE_TRIANGLE));
    auto* positions = static_cast<Vec3*>(rtcSetNewGeometryBuffer(
        geometry.get(), RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(Vec3), mesh.positions.size()));
    auto* indices = static_cast<uint32_t*>(rtcSetNewGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_INDEX, 0,
                                                                   RTC_FORMAT_UINT3, 3 * sizeof(uint32_t),
                                                                   mesh.triangles.size() / 3));
    if (positions == nullptr || indices == nullptr) return nullptr;
    for (size_t i = 0; i < mesh.positions.size(); ++i) positions[i] = to_world.Point(mesh.positions[i]);
    std::copy(mesh.triangles.begin(), mesh.triangles.end(), indices);
    if (openness != Openness::kSolid) {
      rtcSetGeometryIntersectFilterFunction(geometry.get(), MeetOrGather);
      rtcSetGeometryOccludedFilterFunction(geometry.get(), openness == Openness::kVeil ? PassAll : PassHoles);
    }
    return geometry;
  }

  Geometry NewInstance(const scene::Mesh& mesh, const scene::Instance& instance, Openness openness) {
    SceneHandle& prototype = prototypes_[instance.mesh];
    if (prototype == nullptr) {
      prototype = NewScene();
      const Geometry triangles = NewTriangles(mesh, Affine{}, openness);
      if (triangles == nullptr) return nullptr;
      rtcCommitGeometry(triangles.get());
      rtcAttachGeometry(prototype.get(), triangles.get());
      Commit(prototype.get());
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
        return absl::ResourceExhaustedError("not enough memory for the scene's acceleration structure");
      default:
        return absl::InternalError("Embree refused the scene's geometry");
    }
  }

  Places places_;
  std::unique_ptr<TaskPool> builder_;
  Device device_;  // released last
  std::vector<SceneHandle> prototypes_;
  SceneHandle world_;
  SceneHandle veils_;
};

}  // namespace

const char* TracingInstructionSet() { return __builtin_cpu_supports("avx2") ? "avx2" : "sse4.2"; }

absl::StatusOr<std::unique_ptr<EmbreeScene>> EmbreeScene::Create(const scene::Scene& scene) {
  auto result = std::make_unique<EmbreeSceneImpl>(scene);
  if (absl::Status status = result->Build(); !status.ok()) return status;
  return result;
}

}  // namespace lumifold::render
