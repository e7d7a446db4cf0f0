#pragma once

#include <optional>
#include <variant>
#include <vector>

#include "filter/manifold/manifold_device.h"
#include "proto/device/socket_stream.h"

namespace lumifold::device {

// A call of filter::ManifoldDevice and its result between two processes of one program on one machine. The
// process with the device is in no sandbox, the caller may be a sandboxed one that a malformed scene has
// taken over: what is received of a call is checked.

/// Calls, and what they refer to.
struct ReceivedFiltering {
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

struct ReceivedProjection {
  Planes color;
  int radius = 1;
  int dimensions = 1;
  std::vector<float> taps;

  filter::ProjectionCall View() const { return {color, radius, dimensions, taps}; }
};

using AnyCall = std::variant<ReceivedFiltering, ReceivedProjection>;

/// Whether a call is within the limits of what is received.
bool CanSend(const filter::ManifoldCall& call);
bool CanSend(const filter::ProjectionCall& call);
bool SendCall(const filter::ManifoldCall& call, SocketStream* to);
bool SendCall(const filter::ProjectionCall& call, SocketStream* to);
/// nullopt: the other end is closed, or this is no call that ManifoldFilterAtPoints or ProjectPatches takes.
std::optional<AnyCall> ReceiveCall(SocketStream* from);

/// What is sent before a result: whether there is one, or the device leaves the call to the caller's
/// processor.
bool SendHasResult(bool has_result, SocketStream* to);
/// nullopt: the other end is closed.
std::optional<bool> ReceiveHasResult(SocketStream* from);
bool SendResult(const filter::ManifoldResult& result, SocketStream* to);
bool SendResult(const Planes& result, SocketStream* to);
/// The result of `call`.
std::optional<filter::ManifoldResult> ReceiveResult(const filter::ManifoldCall& call, SocketStream* from);
std::optional<Planes> ReceiveResult(const filter::ProjectionCall& call, SocketStream* from);

}  // namespace lumifold::device
