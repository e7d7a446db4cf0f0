#pragma once

#include <functional>
#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "lumifold/v1/farm.pb.h"
#include "server/ledger/owner.h"

namespace grpc {
class Service;
}  // namespace grpc

namespace lumifold::cluster {
class FarmPeers;
}  // namespace lumifold::cluster

namespace lumifold::server {

class AssetChecks;
class CallGate;
class JobApi;
class JobChangeApi;
class OperatorApi;
class PreviewMaker;
class SubmissionApi;
class WorkerApi;
struct Traffic;

/// What the services are made of; all must outlive them.
struct ServiceParts {
  // Of a coordinator.
  SubmissionApi* submissions = nullptr;
  JobApi* jobs = nullptr;
  JobChangeApi* changes = nullptr;
  OperatorApi* operators = nullptr;
  WorkerApi* workers = nullptr;
  Traffic* traffic = nullptr;
  ledger::Epoch epoch = {};

  AssetChecks* checks = nullptr;
  CallGate* gate = nullptr;
  cluster::FarmPeers* peers = nullptr;
  PreviewMaker* previews = nullptr;
  /// Makes a link to the status page for the owner of a credential.
  std::function<absl::StatusOr<v1::PageLink>(const std::string& credential, const v1::CreatePageLinkRequest&)>
      make_link;
};

/// FarmService. Handlers pass the gate, call the coordinator, those that use assets after `checks`, and
/// convert the result. Calls about jobs of other coordinators go to them.
std::unique_ptr<grpc::Service> MakeFarmService(const ServiceParts& parts);

}  // namespace lumifold::server
