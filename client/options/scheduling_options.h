#pragma once

#include <string>
#include <vector>

#include "client/cli/command_line.h"
#include "client/cli/environment.h"
#include "lumifold/v1/job.pb.h"

namespace lumifold::client {

/// Priorities of jobs.
inline constexpr int kMinPriority = -100;
inline constexpr int kMaxPriority = 100;

/// Adds --name.
void AddJobName(CommandLine& command_line, std::string* name);

/// Options of `submit`: how a job is scheduled. None of them changes the picture.
struct SchedulingOptions {
  explicit SchedulingOptions(const Environment& environment) : user(environment.defaults.user) {}

  void AddTo(CommandLine& command_line);
  v1::Scheduling ToProto() const;

  std::string name;
  int priority = 0;
  std::string user;
  std::vector<std::string> tags;
  int max_leases = 0;  // no limit
  std::vector<std::string> after;
  std::string numeric_class;
  bool paused = false;
  std::string webhook;
  float audit_share = 0;
};

}  // namespace lumifold::client
