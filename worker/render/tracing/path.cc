#include "worker/render/tracing/path.h"

namespace lumifold::render {
namespace {

/// Glossy radiance is not divided by a directional albedo below this.
constexpr float kMinGlossyAlbedo = 1e-6f;

/// Stores glossy radiance as G, with S in place. Channels whose S is too small go to the remainder.
void Demodulate(Vec3 radiance, LayerSample* out) {
  const auto over = [](float value, float by) { return by > kMinGlossyAlbedo ? value / by : 0.0f; };
  const auto rest = [](float value, float by) { return by > kMinGlossyAlbedo ? 0.0f : value; };
  const Vec3 s = out->glossy_albedo;
  out->glossy = {over(radiance.x, s.x), over(radiance.y, s.y), over(radiance.z, s.z)};
  out->remainder = {rest(radiance.x, s.x), rest(radiance.y, s.y), rest(radiance.z, s.z)};
}

}  // namespace

void Path::LeaveByDelta(const Surface& surface, const BsdfSample& event) {
  throughput *= event.weight.non_diffuse;
  if (vertex == 0) branch = event.transmitted ? layers::Branch::kTransmission : layers::Branch::kReflection;
  options.is_direct_only = false;
  Leave(surface, event);
  if (vertex > options.levels) Begin(PathPart::kTail, throughput);
}

void Path::AddEmission(Vec3 radiance) {
  const Vec3 arriving = throughput * radiance;
  if (part != PathPart::kSeen) {
    (incident.has_scattered ? incident.indirect : incident.direct) += arriving;
    return;
  }
  (vertex == 0 ? out->emitted : out->levels.Set({branch, vertex}).emitted) = arriving;
  out->combined += arriving;
}

void Path::Add(const Connection& connection) {
  if (connection.is_seen <= 0) {
    incident.indirect += connection.factor * connection.light;
    return;
  }
  seen.direct = connection.light * connection.value.diffuse;
  seen.glossy = connection.light * connection.value.non_diffuse;
  seen.total = connection.light * connection.factor;
}

void Path::CloseSeen() {
  if (!seen.is_open) return;
  seen.is_open = false;
  Vec3 indirect;
  if (part == PathPart::kLit) {
    seen.direct += incident.direct * seen.weight.diffuse;
    indirect = incident.indirect * seen.weight.diffuse;
    seen.glossy += (incident.direct + incident.indirect) * seen.weight.non_diffuse;
    seen.total += (incident.direct + incident.indirect) * seen.total_weight;
  }
  if (seen.depth == 0) {
    out->direct = seen.direct;
    out->indirect = indirect;
    Demodulate(seen.throughput * seen.glossy, out);
  } else {
    LevelSample& level = out->levels.Set({branch, seen.depth});
    level.direct = seen.direct;
    level.indirect = indirect;
    out->remainder += seen.throughput * seen.glossy;
  }
  out->combined += seen.throughput * seen.total;
}

void Path::Finish() {
  CloseSeen();
  if (part != PathPart::kTail) return;
  const Vec3 radiance = before * (incident.direct + incident.indirect);
  out->remainder += radiance;
  out->combined += radiance;
}

}  // namespace lumifold::render
