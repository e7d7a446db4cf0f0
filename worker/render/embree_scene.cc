#include "worker/render/embree_scene.h"

#include <embree3/rtcore.h>

#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "filter/image/parallel.h"

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

class EmbreeSceneImpl final : public EmbreeScene {
 public:
  Hit Intersect(const Ray& ray) const override {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    RTCRayHit query = {EmbreeRay(ray), {}};
    query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    rtcIntersect1(world_.get(), &context, &query);
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

  bool IsOccluded(const Ray& ray) const override {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    RTCRay query = EmbreeRay(ray);
    rtcOccluded1(world_.get(), &context, &query);
    return query.tfar < 0;
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
      const Geometry geometry = uses[instance.mesh] == 1 ? NewTriangles(mesh, instance.world_from_object)
                                                         : NewInstance(mesh, instance);
      if (geometry == nullptr) break;
      rtcCommitGeometry(geometry.get());
      rtcAttachGeometryByID(world_.get(), geometry.get(), static_cast<unsigned>(i));
    }
    Commit(world_.get());
    return DeviceError();
  }

 private:
  /// Builds the tree on this thread. (The device's own "threads=1" would do so too, but for as long as the
  /// device lives it holds every TBB pool of the process to one thread.)
  void Commit(RTCScene scene) {
    builder_->Run(1, [scene](int64_t) { rtcCommitScene(scene); });
  }

  SceneHandle NewScene() const {
    SceneHandle handle(rtcNewScene(device_.get()));
    rtcSetSceneFlags(handle.get(), RTC_SCENE_FLAG_ROBUST);
    rtcSetSceneBuildQuality(handle.get(), RTC_BUILD_QUALITY_HIGH);
    return handle;
  }

  Geometry NewTriangles(const scene::Mesh& mesh, const Affine& to_world) const {
    Geometry geometry(rtcNewGeometry(device_.get(), RTC_GEOMETRY_TYPE_TRIANGLE));
    auto* positions = static_cast<Vec3*>(rtcSetNewGeometryBuffer(
        geometry.get(), RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(Vec3), mesh.positions.size()));
    auto* indices = static_cast<uint32_t*>(rtcSetNewGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_INDEX, 0,
                                                                   RTC_FORMAT_UINT3, 3 * sizeof(uint32_t),
                                                                   mesh.triangles.size() / 3));
    if (positions == nullptr || indices == nullptr) return nullptr;
    for (size_t i = 0; i < mesh.positions.size(); ++i) positions[i] = to_world.Point(mesh.positions[i]);
    std::copy(mesh.triangles.begin(), mesh.triangles.end(), indices);
    return geometry;
  }

  Geometry NewInstance(const scene::Mesh& mesh, const scene::Instance& instance) {
    SceneHandle& prototype = prototypes_[instance.mesh];
    if (prototype == nullptr) {
      prototype = NewScene();
      const Geometry triangles = NewTriangles(mesh, Affine{});
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
};

}  // namespace

const char* TracingInstructionSet() { return __builtin_cpu_supports("avx2") ? "avx2" : "sse4.2"; }

absl::StatusOr<std::unique_ptr<EmbreeScene>> EmbreeScene::Create(const scene::Scene& scene) {
  auto result = std::make_unique<EmbreeSceneImpl>(scene);
  if (absl::Status status = result->Build(); !status.ok()) return status;
  return result;
}

}  // namespace lumifold::render
