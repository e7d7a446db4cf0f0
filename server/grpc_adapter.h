#pragma once

#include <memory>
#include <vector>

namespace grpc {
class Service;
}  // namespace grpc

namespace lumifold::server {

class Coordinator;

/// FarmService and WorkerService over a coordinator: each handler calls it and converts, none decides. The
/// coordinator must outlive them.
std::vector<std::unique_ptr<grpc::Service>> MakeServices(Coordinator* coordinator);

}  // namespace lumifold::server
