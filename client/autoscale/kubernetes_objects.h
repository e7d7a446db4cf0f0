#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "client/autoscale/policy/types.h"

/// The objects of the Kubernetes API that the autoscaler reads, from their JSON. Fields that are missing have
/// the API's defaults. Errors of all: kDataLoss saying what is not understood.
namespace lumifold::autoscale {

/// Annotation of pods: those with lower numbers are ended first.
inline constexpr char kDeletionCost[] = "controller.kubernetes.io/pod-deletion-cost";

/// The scale subresource of a Deployment.
struct Scale {
  int replicas = 0;
  std::string selector;  // of its pods, as a query takes it
  std::string version;
};
absl::StatusOr<Scale> ParseScale(absl::string_view json);

/// Why the Deployment's pods are not made ("exceeded quota: ..."); empty if they are.
absl::StatusOr<std::string> ParseReplicaFailure(absl::string_view json);

struct PodPage {
  std::vector<Request> pods;
  /// Pods whose deletion cost is below that of pods without one.
  std::vector<std::string> marked;
  std::string next;  // token of the next page; empty on the last one
};
/// A pod is a request whose id and worker are called as the pod. `default_cores`: of pods that request no
/// processors.
absl::StatusOr<PodPage> ParsePods(absl::string_view json, double default_cores);

/// The message of an error (a Status object), or the start of what is none.
std::string MessageOf(absl::string_view json);

}  // namespace lumifold::autoscale
