#pragma once

#include <memory>
#include <vector>

namespace grpc {
class Service;
}  // namespace grpc

namespace lumifold::server {

class AssetChecks;
class Coordinator;

/// FarmService and WorkerService of a coordinator. Handlers only call the coordinator, those that use assets after
/// `checks`, and convert the result. Both must outlive the services.
std::vector<std::unique_ptr<grpc::Service>> MakeServices(Coordinator* coordinator, AssetChecks* checks);

}  // namespace lumifold::server
