#include "server/access/identity.h"

namespace lumifold::access {

Identity LocalIdentity() {
  return {.kind = IdentityKind::kLocal,
          .name = "local",
          .scopes = {Scope::kRead, Scope::kSubmit, Scope::kAdmin},
          .id = ""};
}

}  // namespace lumifold::access
