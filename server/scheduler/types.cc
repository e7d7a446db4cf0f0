#include "server/scheduler/types.h"

namespace lumifold::scheduler {

JobOptions OptionsOf(const v1::Scheduling& scheduling) {
  return {.priority = scheduling.priority(),
          .turn = scheduling.turn_ms(),
          .user = scheduling.user(),
          .tags = {scheduling.tags().begin(), scheduling.tags().end()},
          .max_leases = scheduling.max_leases(),
          .numeric_class = scheduling.numeric_class(),
          .paused = scheduling.paused(),
          .audit_share = scheduling.audit_share()};
}

}  // namespace lumifold::scheduler
