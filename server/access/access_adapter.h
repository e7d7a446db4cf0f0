#pragma once

#include <memory>

#include "server/access/identity.h"

namespace grpc {
class Service;
}  // namespace grpc

namespace lumifold::access {

class AccessControl;

/// AccessService. `access` is null for a coordinator without access control. Both must outlive the service.
std::unique_ptr<grpc::Service> MakeAccessService(AccessControl* access, const Callers* callers);

}  // namespace lumifold::access
