#pragma once

#include <map>
#include <string>
#include <vector>

#include "lumifold/v1/farm.pb.h"
#include "lumifold/v1/job.pb.h"
#include "server/scheduler/types.h"

namespace lumifold::server {

/// Sums up what active jobs have left to render, for ServerStatus.demand.
class DemandSum {
 public:
  void Add(const v1::Scheduling& scheduling, const scheduler::JobProgress& progress);
  void AddTo(v1::ServerStatus* status) const;

 private:
  using Tags = std::vector<std::string>;  // sorted, each once
  std::map<std::string, std::map<Tags, v1::Demand>> by_user_;
};

}  // namespace lumifold::server
