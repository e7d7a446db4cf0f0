#pragma once

#include <memory>
#include <vector>

namespace grpc {
class Service;
}  // namespace grpc

namespace lumifold::server {

struct ServiceParts;

/// FarmService and WorkerService of a coordinator. Handlers pass the gate, call the coordinator, those that
/// use assets after ServiceParts::checks, and convert the result.
std::vector<std::unique_ptr<grpc::Service>> MakeServices(const ServiceParts& parts);

}  // namespace lumifold::server
