#pragma once

#include <memory>

namespace grpc {
class Service;
}  // namespace grpc

namespace lumifold::access {
class AccessControl;
}  // namespace lumifold::access

namespace lumifold::server {

class CallGate;

/// AccessService. `access` is null for a coordinator without access control. Both must outlive the service.
std::unique_ptr<grpc::Service> MakeAccessService(access::AccessControl* access, CallGate* gate);

}  // namespace lumifold::server
