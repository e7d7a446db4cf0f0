#pragma once

#include <array>
#include <optional>
#include <vector>

#include "absl/types/span.h"
#include "filter/manifold/filter_device.h"
#include "proto/device/call_messages.h"
#include "proto/device/socket_stream.h"

namespace lumifold::device {

// Refinements of filter::FilterDevice, as call_messages.h has filterings.

struct ReceivedRefinement {
  ReceivedCalls filterings;
  filter::RefineCall call;  // without planes and lists
  std::array<std::vector<float>, 2> noisy, base, coverage;
  std::vector<float> offsets, point_weights, point_samples;

  /// `calls`: the view of the filterings.
  filter::RefineCall View(absl::Span<const filter::ManifoldCall> calls) const;
};

bool CanSend(const filter::RefineCall& call);
bool SendRefinement(const filter::RefineCall& call, SentPlanes* kept, SocketStream* to);
/// After its operation. nullopt: the other end is closed, or this is no refinement of a layer. It refers to
/// `kept`.
std::optional<ReceivedRefinement> ReceiveRefinement(KeptPlanesOfCaller* kept, SocketStream* from);

bool SendResult(const filter::RefinedHalves& result, SocketStream* to);
std::optional<filter::RefinedHalves> ReceiveResult(const filter::RefineCall& call, SocketStream* from);

}  // namespace lumifold::device
