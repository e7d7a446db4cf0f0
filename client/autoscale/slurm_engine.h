#pragma once

#include <memory>
#include <string>
#include <vector>

#include "absl/time/time.h"
#include "client/autoscale/engine.h"

namespace lumifold::autoscale {

struct SlurmOptions {
  /// Letters, digits, "-", "_" and "."; part of the jobs' names.
  std::string farm = {};
  /// The batch script (deploy/slurm/worker.sbatch), and arguments of sbatch and of the script.
  std::string script = {};
  std::vector<std::string> sbatch_arguments = {};
  std::vector<std::string> script_arguments = {};
  /// Of each command.
  absl::Duration timeout = absl::Seconds(30);
};

/// Slurm, by its commands sbatch, squeue and scancel, as the user who runs this program. A request is a job
/// called "lumifold-FARM-SLOT"; starts take the lowest free slots, so that autoscalers that start at the same
/// time take the same ones, and Slurm runs one job of each.
std::unique_ptr<Engine> MakeSlurmEngine(SlurmOptions options);

}  // namespace lumifold::autoscale
