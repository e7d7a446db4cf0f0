#pragma once

#include <memory>
#include <vector>

namespace grpc {
class Service;
}  // namespace grpc

namespace lumifold::server {

class Coordinator;

/// FarmService and WorkerService of a coordinator. Handlers only call the coordinator and convert the result.
/// The coordinator must outlive the services.
std::vector<std::unique_ptr<grpc::Service>> MakeServices(Coordinator* coordinator);

}  // namespace lumifold::server
