#pragma once

#include <memory>

namespace grpc {
class Service;
}  // namespace grpc

namespace lumifold::server {

class AssetChecks;
class CallGate;
class Coordinator;
class FarmPeers;
class PreviewMaker;

/// FarmService. Handlers pass the gate, call the coordinator, those that use assets after `checks`, and convert the result.
/// Calls about jobs of other coordinators go to them. All must outlive the service.
std::unique_ptr<grpc::Service> MakeFarmService(Coordinator* coordinator, AssetChecks* checks, CallGate* gate,
                                               FarmPeers* peers, PreviewMaker* previews);

}  // namespace lumifold::server
