#include "server/job/unit.h"

#include "absl/strings/str_cat.h"

namespace lumifold::job {

v1::UnitId ProtoFromUnit(const UnitRef& unit) {
  v1::UnitId id;
  id.set_job_id(unit.job.value());
  id.set_frame(unit.key.frame);
  id.set_tile(unit.key.tile);
  id.set_pass(unit.key.pass);
  id.set_kind(unit.key.kind);
  return id;
}

UnitRef UnitFromProto(const v1::UnitId& id) {
  return {JobId(id.job_id()), {id.frame(), id.tile(), id.pass(), id.kind()}};
}

std::string Describe(const UnitRef& unit) {
  if (unit.key.kind == v1::UNIT_KIND_PLAN) return absl::StrCat(unit.job.value(), " plan");
  const std::string frame = absl::StrCat(unit.job.value(), " frame ", unit.key.frame);
  if (unit.key.kind == v1::UNIT_KIND_RESULT) return absl::StrCat(frame, " result");
  if (unit.key.kind == v1::UNIT_KIND_BLOCK) return absl::StrCat(frame, " block ", unit.key.tile);
  if (unit.key.kind == v1::UNIT_KIND_ESTIMATE)
    return absl::StrCat(frame, " estimate of round ", unit.key.pass);
  const std::string place = absl::StrCat(frame, " tile ", unit.key.tile);
  if (unit.key.kind == v1::UNIT_KIND_GEOMETRY) return absl::StrCat(place, " geometry");
  return absl::StrCat(place, " pass ", unit.key.pass);
}

}  // namespace lumifold::job
