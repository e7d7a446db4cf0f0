#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "filter/manifold/fit_call.h"
#include "proto/device/socket_stream.h"

namespace lumifold::device {

// Fits of filter::FilterDevice, as call_messages.h has filterings.

struct ReceivedFit {
  filter::FitCall call;  // without lists
  std::vector<int32_t> firsts, targets;
  std::vector<float> samples;

  filter::FitCall View() const;
};

bool CanSend(const filter::FitCall& call);
bool SendFit(const filter::FitCall& call, SocketStream* to);
/// After its operation. nullopt: the other end is closed, or this is no call of a ModelGrid. Places of
/// samples are set to their pixels.
std::optional<ReceivedFit> ReceiveFit(SocketStream* from);
bool SendResult(const filter::FitResult& result, SocketStream* to);
std::optional<filter::FitResult> ReceiveResult(const filter::FitCall& call, SocketStream* from);

}  // namespace lumifold::device
