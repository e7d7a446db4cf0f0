#include "server/film/stored_stats.h"

#include <string>
#include <utility>

#include "proto/rpc/bounded_text.h"
#include "proto/rpc/limits.h"

namespace lumifold::film {
namespace {

/// Longest time of a unit that is believed, as a worker says it: a year.
constexpr double kMaxUnitSeconds = 366.0 * 24 * 3600;

}  // namespace

v1::UnitStats StoredStats(const v1::UnitStats& delivered) {
  v1::UnitStats stats;
  stats.set_samples(delivered.samples());
  stats.set_bad_samples(delivered.bad_samples());
  stats.set_rays(delivered.rays());
  const double seconds = delivered.seconds();
  stats.set_seconds(seconds >= 0 && seconds <= kMaxUnitSeconds ? seconds : 0);
  for (std::string& line :
       rpc::BoundedLines(delivered.warnings(), rpc::kMaxUnitWarnings, rpc::kMaxWarningBytes))
    stats.add_warnings(std::move(line));
  for (const float value : delivered.camera().world_to_camera())
    stats.mutable_camera()->add_world_to_camera(value);
  for (const float value : delivered.camera().world_to_ndc()) stats.mutable_camera()->add_world_to_ndc(value);
  stats.set_catches_shadows(delivered.catches_shadows());
  stats.set_environment(rpc::BoundedLine(delivered.environment(), rpc::kMaxObjectNameBytes));
  for (const v1::SceneObject& object : delivered.objects()) {
    v1::SceneObject* const stored = stats.add_objects();
    stored->set_name(rpc::BoundedLine(object.name(), rpc::kMaxObjectNameBytes));
    stored->set_material(rpc::BoundedLine(object.material(), rpc::kMaxObjectNameBytes));
  }
  return stats;
}

}  // namespace lumifold::film
