#pragma once

#include <memory>
#include <string>

#include "absl/time/time.h"
#include "client/autoscale/engine.h"

namespace lumifold::autoscale {

struct KubernetesOptions {
  std::string api;  // "https://HOST:PORT"
  std::string deployment;
  std::string name_space;
  /// Read anew for each call, because the cluster replaces tokens; empty: none.
  std::string token_file;
  std::string ca_file;
  double cores_per_worker = 1;  // of pods that request none
  /// Of each call.
  absl::Duration timeout = absl::Seconds(10);
};

/// A Deployment of workers, by the Kubernetes API. A start or release changes its number of replicas in the
/// version that was seen: of two autoscalers that change it at the same time one gets kAborted. Replicas
/// without a pod are pending requests. Released pods get a low deletion cost, so that the cluster ends those
/// and no busy ones.
std::unique_ptr<Engine> MakeKubernetesEngine(KubernetesOptions options);

}  // namespace lumifold::autoscale
