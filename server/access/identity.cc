#include "server/access/identity.h"

namespace lumifold::access {

Identity LocalIdentity() {
  return {.kind = IdentityKind::kLocal,
          .name = "local",
          .scopes = {Scope::kRead, Scope::kSubmit, Scope::kAdmin},
          .id = ""};
}

std::string KeyOf(const Identity& caller) {
  switch (caller.kind) {
    case IdentityKind::kLocal:
      return "local/" + caller.name;
    case IdentityKind::kPerson:
      return "person/" + caller.name;
    case IdentityKind::kWorker:
      return "worker/" + caller.name;
  }
  return "";
}

}  // namespace lumifold::access
