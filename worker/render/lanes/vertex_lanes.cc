#include "worker/render/lanes/vertex_lanes.h"

#include <limits>

#include "filter/image/portable_math.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "worker/render/lanes/vertex_lanes.cc"
#include "hwy/foreach_target.h"
#include "hwy/highway.h"

#include "worker/render/lanes/base_lobes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace lumifold::render {
namespace HWY_NAMESPACE {

/// The paths from number `first` on.
HWY_INLINE Num At(const LaneRow& row, size_t first) { return Load(row.data() + first); }
HWY_INLINE Num3 At(const LaneVec& rows, size_t first) {
  return {At(rows.x, first), At(rows.y, first), At(rows.z, first)};
}
HWY_INLINE Num2 At(const LanePair& rows, size_t first) { return {At(rows.x, first), At(rows.y, first)}; }
HWY_INLINE void Put(Num a, size_t first, LaneRow* row) { Store(a, row->data() + first); }

/// The vertices of the paths from number `first` on, and what is read of them.
struct Vertices {
  const VertexLanes* in;
  size_t first;
  Num3 position, geometric;
  Num epsilon;
  Num cone_width, cone_spread;
  Num time;
  Num3 throughput;
  Mask is_seen;
  BaseLobes lobes;

  const LaneVertex& operator[](size_t lane) const { return in->vertices[first + lane]; }

  HWY_INLINE Vertices(const VertexLanes& vertices, size_t first_path, const float* albedos)
      : in(&vertices), first(first_path) {
    const auto surface = [&](size_t lane) { return &(*this)[lane].surface->position.x; };
    const Num4 place = LoadFours(surface);
    position = place.xyz();
    epsilon = place.w;
    const Num4 normal = LoadFours([&](size_t lane) { return surface(lane) + 4; });
    cone_width = normal.w;
    const Num4 face = LoadFours([&](size_t lane) { return surface(lane) + 8; });
    geometric = face.xyz();
    cone_spread = face.w;
    throughput = LoadFours([&](size_t lane) { return &(*this)[lane].path->throughput.x; }).xyz();
    is_seen = At(in->choice.is_seen, first) > Num(0.0f);
    BeginLobes(normal.xyz(), albedos);
  }

  HWY_INLINE void BeginLobes(Num3 normal, const float* albedos) {
    const auto material = [&](size_t lane) { return &(*this)[lane].material->base_color.x; };
    const Num4 base = LoadFours(material);
    const Num4 facets = LoadFours([&](size_t lane) { return material(lane) + 4; });
    const Num4 layer = LoadFours([&](size_t lane) { return material(lane) + 8; });
    const Num4 rest = LoadFours([&](size_t lane) { return material(lane) + 12; });
    lobes.geometric = geometric;
    lobes.f0 = facets.xyz();
    lobes.f90 = {facets.w, facets.w, facets.w};
    lobes.alpha = layer.x;
    lobes.root_alpha = layer.y;
    lobes.dielectric_f0 = layer.z;
    lobes.dielectric_f90 = layer.w;
    lobes.mean_albedo = rest.x;
    const Num4 ray = LoadFours([&](size_t lane) { return &(*this)[lane].ray->direction.x; });
    time = ray.w;
    lobes.Begin(normal, {-ray.x, -ray.y, -ray.z}, base.xyz(), base.w, rest.y, albedos);
  }

  /// Surface::Offset.
  HWY_INLINE Num3 Offset(Num3 direction) const {
    return position + geometric * Select(Dot(direction, geometric) < Num(0.0f), -epsilon, epsilon);
  }
};

/// Of a ray: its greatest distance, and its cone.
struct Reach {
  Num max_distance, width, spread;
};

/// Writes rays that leave the surfaces.
template <typename RayOf>
HWY_INLINE void PutRay(const Vertices& v, Num3 origin, Num3 direction, Reach reach, const RayOf& ray) {
  const Num zero = 0.0f;
  StoreFours({origin.x, origin.y, origin.z, zero}, [&](size_t lane) { return &ray(lane)->origin.x; });
  StoreFours({direction.x, direction.y, direction.z, v.time},
             [&](size_t lane) { return &ray(lane)->direction.x; });
  StoreFours({reach.max_distance, reach.width, reach.spread, zero},
             [&](size_t lane) { return &ray(lane)->max_distance; });
}

/// Direction towards the light, its distance and radiance, and the density of the sample; 0: there is none.
struct PickedLight {
  Num3 direction;
  Num distance;
  Num3 radiance;
  Num pdf;
  Num competes;  // 0: sampled directions cannot hit the light
};

/// See LightSet::SampleTriangle.
HWY_INLINE PickedLight SampleTriangles(const Vertices& v) {
  const auto triangle = [&](size_t lane) { return &v[lane].triangle->corner.x; };
  const Num4 corner = LoadFours(triangle);
  const Num4 edge1 = LoadFours([&](size_t lane) { return triangle(lane) + 4; });
  const Num4 edge2 = LoadFours([&](size_t lane) { return triangle(lane) + 8; });
  const Num4 normal = LoadFours([&](size_t lane) { return triangle(lane) + 12; });
  const Num2 u = At(v.in->random.light_point, v.first);
  const Num least = edge2.w * Min(u.x, u.y);
  const Num3 to_light = corner.xyz() + edge1.xyz() * (u.x - least) + edge2.xyz() * (u.y - least) - v.position;
  const Num distance2 = Dot(to_light, to_light);
  PickedLight light;
  light.distance = Sqrt(distance2);
  light.direction = to_light * (Num(1.0f) / light.distance);
  light.radiance = LoadFours([&](size_t lane) { return triangle(lane) + 16; }).xyz();
  const Num cosine = -Dot(light.direction, normal.xyz());
  const Mask faces = And(cosine != Num(0.0f), Or(cosine > Num(0.0f), edge1.w > Num(0.0f)));
  light.pdf = Where(And(distance2 > Num(0.0f), faces),
                    corner.w * distance2 / Abs(cosine) * At(v.in->choice.probability, v.first));
  light.competes = 1.0f;
  return light;
}

HWY_INLINE PickedLight PickLights(const Vertices& v) {
  PickedLight light = SampleTriangles(v);
  const LightLanes& in = v.in->light;
  const Mask is_sampled = At(in.is_sampled, v.first) > Num(0.0f);
  if (!Any(is_sampled)) return light;
  light.direction = Select(is_sampled, At(in.direction, v.first), light.direction);
  light.distance = Select(is_sampled, At(in.distance, v.first), light.distance);
  light.radiance = Select(is_sampled, At(in.radiance, v.first), light.radiance);
  light.pdf = Select(is_sampled, At(in.pdf, v.first), light.pdf);
  light.competes = Where(Not(And(is_sampled, At(in.is_delta, v.first) > Num(0.0f))), Num(1.0f));
  return light;
}

HWY_INLINE Num3 TotalOf(const BaseLobes& lobes, Num diffuse, Num3 non_diffuse) {
  return lobes.diffuse_albedo * diffuse + non_diffuse;
}

/// See PathTracer::SampleLight.
HWY_INLINE void Connect(const Vertices& v, const float* albedos) {
  const PickedLight light = PickLights(v);
  const LobeValue value = v.lobes.Evaluate(light.direction, albedos);
  const Mask is_lit =
      And(light.pdf > Num(0.0f), Or(value.diffuse > Num(0.0f), MaxComponent(value.non_diffuse) > Num(0.0f)));
  const Num competing = Where(light.competes > Num(0.0f), value.pdf);
  const Num3 arriving = Where(is_lit, light.radiance * (Num(1.0f) / (light.pdf + competing)));
  const Num3 total = TotalOf(v.lobes, value.diffuse, value.non_diffuse);
  const Num3 factor = Select(v.is_seen, total, v.throughput * total);
  const auto connection = [&](size_t lane) { return &v[lane].connection->value.diffuse; };
  StoreFours({value.diffuse, value.non_diffuse.x, value.non_diffuse.y, value.non_diffuse.z}, connection);
  StoreFours({factor.x, factor.y, factor.z, Where(v.is_seen, Num(1.0f))},
             [&](size_t lane) { return connection(lane) + 4; });
  StoreFours({arriving.x, arriving.y, arriving.z, Num(0.0f)},
             [&](size_t lane) { return connection(lane) + 8; });
  // The shadow ray ends before the light, at the sampled point itself; see SetShadowRay.
  const Num3 origin = v.Offset(light.direction);
  const Num3 segment = v.position + light.direction * light.distance - origin;
  const Num length = Length(segment);
  const Mask is_finite = light.distance < Num(hwy::HighestValue<float>());
  const Num3 direction = Select(is_finite, segment * (Num(1.0f) / length), light.direction);
  const Num distance = Select(is_finite, length * Num(1.0f - 0x1p-12f), light.distance);
  PutRay(v, origin, direction, {distance, 0.0f, 0.0f}, [&](size_t lane) { return v[lane].shadow_ray; });
}

/// Writes what the layers keep of surfaces that are seen, and of the step from there.
HWY_INLINE void PutSeen(const Vertices& v, const LobeValue& weight, Num3 total, ShadedLanes* out) {
  const BaseLobes& lobes = v.lobes;
  const auto seen = [&](size_t lane) { return &out->seen[v.first + lane].diffuse_albedo.x; };
  const auto put = [&](size_t offset, Num3 a, Num w) {
    StoreFours({a.x, a.y, a.z, w}, [&](size_t lane) { return seen(lane) + offset; });
  };
  put(0, lobes.diffuse_albedo, Where(lobes.p_diffuse > Num(0.0f), Num(1.0f)));
  put(4, lobes.facets_albedo, Where(lobes.p_facets > Num(0.0f), Num(1.0f)));
  StoreFours({weight.diffuse, weight.non_diffuse.x, weight.non_diffuse.y, weight.non_diffuse.z},
             [&](size_t lane) { return seen(lane) + 8; });
  put(12, total, 0.0f);
}

/// Surface::SpawnRay.
HWY_INLINE void SpawnRay(const Vertices& v, Num3 direction, Num pdf) {
  const Num spread =
      Where(v.cone_width > Num(0.0f), Max(v.cone_spread, Num(kConeShareOfDensity) / Sqrt(pdf)));
  const Num far = std::numeric_limits<float>::infinity();
  PutRay(v, v.Offset(direction), direction, {far, v.cone_width, spread},
         [&](size_t lane) { return v[lane].ray; });
}

/// See PathTracer::TakeStep.
HWY_INLINE void TakeStep(const Vertices& v, const float* albedos, ShadedLanes* out) {
  const Num one = 1.0f;
  const ChoiceLanes& choice = v.in->choice;
  const Num3 before = LoadFours([&](size_t lane) { return &v[lane].path->before.x; }).xyz();
  const Num estimate = MaxComponent(before * v.throughput * (v.lobes.diffuse_albedo + v.lobes.facets_albedo));
  const Num factor = At(choice.roulette, v.first);
  const Num survival = Select(factor > Num(0.0f), Min(one, factor * estimate), one);
  const Num u = At(v.in->random.light_and_lobe.y, v.first);
  const Mask is_certain = survival >= one;
  const Mask survives = Or(is_certain, u < survival);
  const Num u_lobe = Select(is_certain, u, Min(u / survival, Num(0x1.fffffep-1f)));
  const LobeSample step = v.lobes.Sample(u_lobe, At(v.in->random.direction, v.first), albedos);
  Put(Where(And(survives, step.value.pdf > Num(0.0f)), one), v.first, &out->goes_on);
  SpawnRay(v, step.direction, step.value.pdf);
  const LobeValue& weight = step.value;
  Num3 throughput = v.throughput * (one / survival) * TotalOf(v.lobes, weight.diffuse, weight.non_diffuse);
  Num3 next_before = before;
  if (Any(v.is_seen)) {
    const LobeValue seen = {weight.diffuse / survival, weight.non_diffuse / survival, weight.pdf};
    const Num3 total = TotalOf(v.lobes, seen.diffuse, seen.non_diffuse);
    PutSeen(v, seen, total, out);
    next_before = Select(v.is_seen, v.throughput * total, before);
    throughput = Select(v.is_seen, {one, one, one}, throughput);
  }
  const auto path = [&](size_t lane) { return &v[lane].path->throughput.x; };
  StoreFours({throughput.x, throughput.y, throughput.z, weight.pdf}, path);
  StoreFours({next_before.x, next_before.y, next_before.z, Num(0.0f)},
             [&](size_t lane) { return path(lane) + 4; });
}

void ShadeLanes(const VertexLanes& in, size_t count, const float* albedos, ShadedLanes* out) {
  for (size_t first = 0; first < count; first += hn::Lanes(LaneTag())) {
    const Vertices vertices(in, first, albedos);
    Connect(vertices, albedos);
    TakeStep(vertices, albedos, out);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace lumifold::render
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace lumifold::render {

HWY_EXPORT(ShadeLanes);

void ShadeLanes(const VertexLanes& in, size_t count, const float* albedos, ShadedLanes* out) {
  HWY_DYNAMIC_DISPATCH(ShadeLanes)(in, count, albedos, out);
}

}  // namespace lumifold::render
#endif
