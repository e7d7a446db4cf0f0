#pragma once

#include <memory>

#include "worker/asset_source.h"
#include "worker/spec_cache.h"

namespace grpc {
class Channel;
}

namespace lumifold::worker {

/// Fetches assets from the coordinator and resumes broken transfers.
std::unique_ptr<AssetSource> MakeRemoteAssetSource(std::shared_ptr<grpc::Channel> channel);

/// Fetches specs from the coordinator.
std::unique_ptr<SpecSource> MakeRemoteSpecSource(std::shared_ptr<grpc::Channel> channel);

}  // namespace lumifold::worker
