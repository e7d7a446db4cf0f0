#include "worker/render/embree_scene.h"

#include <embree3/rtcore.h>

#include <algorithm>
#include <string>
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

/// What the filters of one query need; Embree hands them its first member's address.
struct QueryContext {
  RTCIntersectContext embree;
  const scene::Scene* scene;
  uint64_t chance;
  const Hit* last_veil = nullptr;  // only hits beyond it count, and all of those

  QueryContext(const scene::Scene* s, const Ray& ray) : scene(s), chance(ray.chance) {
    rtcInitIntersectContext(&embree);
  }
};

/// A hit that a filter is to judge.
struct Candidate {
  const QueryContext* context;
  int instance;
  uint32_t triangle;
  float u;
  float v;
  float distance;

  explicit Candidate(const RTCFilterFunctionNArguments* arguments)
      : context(reinterpret_cast<const QueryContext*>(arguments->context)),
        triangle(RTCHitN_primID(arguments->hit, 1, 0)),
        u(RTCHitN_u(arguments->hit, 1, 0)),
        v(RTCHitN_v(arguments->hit, 1, 0)),
        distance(RTCRayN_tfar(arguments->ray, 1, 0)) {
    const unsigned placed = RTCHitN_instID(arguments->hit, 1, 0, 0);
    instance =
        static_cast<int>(placed != RTC_INVALID_GEOMETRY_ID ? placed : RTCHitN_geomID(arguments->hit, 1, 0));
  }

  float Opacity() const {
    const scene::Scene& scene = *context->scene;
    return OpacityAt(scene, scene.meshes[scene.instances[instance].mesh], triangle, u, v);
  }

  bool LiesBeyond(const Hit& last) const {
    if (distance != last.distance) return distance > last.distance;
    if (instance != last.instance) return instance > last.instance;
    return triangle > last.triangle;
  }

  /// The same answer whenever a ray of this chance asks about this triangle: Embree may ask twice.
  bool IsMet() const {
    const float opacity = Opacity();
    if (opacity >= 1 || opacity <= 0) return opacity >= 1;
    const uint64_t place = (static_cast<uint64_t>(static_cast<uint32_t>(instance)) << 32) | triangle;
    return static_cast<float>(MixBits(MixBits(context->chance) ^ MixBits(~place)) >> 40) * 0x1p-24f < opacity;
  }
};

void FilterNearest(const RTCFilterFunctionNArguments* arguments) {
  const Candidate candidate(arguments);
  const Hit* last = candidate.context->last_veil;
  const bool keep = last != nullptr ? candidate.LiesBeyond(*last) : candidate.IsMet();
  if (!keep) arguments->valid[0] = 0;
}

void PassHoles(const RTCFilterFunctionNArguments* arguments) {
  if (Candidate(arguments).Opacity() <= 0) arguments->valid[0] = 0;
}

void PassAll(const RTCFilterFunctionNArguments* arguments) { arguments->valid[0] = 0; }

class EmbreeSceneImpl final : public EmbreeScene {
 public:
  Hit Intersect(const Ray& ray) const override {
    QueryContext context(scene_, ray);
    return Nearest(world_.get(), EmbreeRay(ray), &context);
  }

  bool IsOccluded(const Ray& ray) const override {
    QueryContext context(scene_, ray);
    RTCRay query = EmbreeRay(ray);
    rtcOccluded1(world_.get(), &context.embree, &query);
    return query.tfar < 0;
  }

  Hit FirstVeil(const Ray& ray) const override {
    Hit before;
    before.distance = -1;
    return NextVeil(ray, before);
  }

  Hit NextVeil(const Ray& ray, const Hit& last) const override {
    constexpr float kJustBefore = 1.0f - 0x1p-20f;  // Embree leaves out what lies exactly where a ray begins
    QueryContext context(scene_, ray);
    context.last_veil = &last;
    RTCRay query = EmbreeRay(ray);
    query.tnear = std::max(last.distance, 0.0f) * kJustBefore;
    return Nearest(veils_.get(), query, &context);
  }

  explicit EmbreeSceneImpl(const scene::Scene& scene) : scene_(&scene), builder_(MakeTaskPool(1)) {}

  absl::Status Build() {
    const scene::Scene& scene = *scene_;
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

  Hit Nearest(RTCScene scene, const RTCRay& ray, QueryContext* context) const {
    RTCRayHit query = {ray, {}};
    query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    rtcIntersect1(scene, &context->embree, &query);
    Hit hit;
    if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return hit;
    const bool instanced = query.hit.instID[0] != RTC_INVALID_GEOMETRY_ID;
    hit.instance = static_cast<int>(instanced ? query.hit.instID[0] : query.hit.geomID);
    hit.triangle = query.hit.primID;
    hit.u = query.hit.u;
    hit.v = query.hit.v;
    hit.distance = query.ray.tfar;
    const Vec3 normal = {query.hit.Ng_x, query.hit.Ng_y, query.hit.Ng_z};
    const Affine& to_world = scene_->instances[hit.instance].world_from_object;
    if (instanced) {
      hit.face_normal = to_world.Normal(normal);
    } else {
      hit.face_normal = to_world.Determinant() < 0
                            ? -normal
                            : normal;  // a mirroring transform has turned the winding round
    }
    return hit;
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
      rtcSetGeometryIntersectFilterFunction(geometry.get(), FilterNearest);
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

  const scene::Scene* scene_;
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
