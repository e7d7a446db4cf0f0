#pragma once

#include <memory>
#include <vector>

namespace grpc {
class Service;
}  // namespace grpc

namespace lumifold::server {

class AssetChecks;
class CallGate;
class Coordinator;
class FarmPeers;
class PreviewMaker;

/// FarmService and WorkerService of a coordinator. Handlers pass the gate, call the coordinator, those that use assets
/// after `checks`, and convert the result. All must outlive the services.
std::vector<std::unique_ptr<grpc::Service>> MakeServices(Coordinator* coordinator, AssetChecks* checks,
                                                         CallGate* gate, FarmPeers* peers,
                                                         PreviewMaker* previews);

}  // namespace lumifold::server
