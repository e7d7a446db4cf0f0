#pragma once

#include <optional>

#include "filter/manifold/manifold_device.h"
#include "proto/device/socket_stream.h"

namespace lumifold::device {

// A call of filter::ManifoldDevice and its result between two processes of one program on one machine. The
// process with the device is in no sandbox, the caller may be a sandboxed one that a malformed scene has
// taken over: what is received of a call is checked.

/// A call, and what it refers to.
struct ReceivedCall {
  Planes signals;
  Planes features;
  Plane mask;
  filter::ManifoldParams params;
  float reach = 1;
  std::optional<filter::SlicePoints> points;

  filter::ManifoldCall View() const {
    return {signals, features, mask.view(), params, reach, points.has_value() ? &*points : nullptr};
  }
};

bool SendCall(const filter::ManifoldCall& call, SocketStream* to);
/// nullopt: the other end is closed, or this is no call that ManifoldFilterAtPoints takes.
std::optional<ReceivedCall> ReceiveCall(SocketStream* from);

bool SendResult(const filter::ManifoldResult& result, SocketStream* to);
/// The result of `call`.
std::optional<filter::ManifoldResult> ReceiveResult(const filter::ManifoldCall& call, SocketStream* from);

}  // namespace lumifold::device
