#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "filter/manifold/filter_device.h"
#include "proto/device/socket_stream.h"

namespace lumifold::device {

// Calls of filter::FilterDevice and their results between two processes of one program on one machine. The
// process with the device is in no sandbox, the caller may be a sandboxed one that a malformed scene has
// taken over: what is received of calls is checked.

/// What a message asks for; it comes first.
enum class Operation : uint32_t { kFilter, kFit, kLayer };
/// nullopt: the other end is closed, or there is none such.
std::optional<Operation> ReceiveOperation(SocketStream* from);

/// A call, and what it refers to.
struct ReceivedCall {
  Planes planes;  // of signals, colours of patches, features and the mask
  std::vector<float> taps;
  std::vector<filter::SlicePoints> points;  // one or none
  filter::ManifoldParams params;
  float reach = 1, scale = 1;
  size_t signals = 0, colors = 0;
  int radius = 0, dimensions = 0;

  filter::ManifoldCall View() const;
};

/// Whether a call is within the limits of what is received.
bool CanSend(const filter::ManifoldCall& call);
/// With its operation.
bool SendCall(const filter::ManifoldCall& call, SocketStream* to);
/// What SendCall() sends, after the operation. nullopt: the other end is closed, or this is no call that
/// ManifoldFilterAtPoints and ProjectPatches take.
std::optional<ReceivedCall> ReceiveCall(SocketStream* from);

/// What is sent before a result: whether there is one, or the device leaves the call to the caller's
/// processor.
bool SendHasResult(bool has_result, SocketStream* to);
/// nullopt: the other end is closed.
std::optional<bool> ReceiveHasResult(SocketStream* from);
bool SendResult(const filter::ManifoldResult& result, SocketStream* to);
std::optional<filter::ManifoldResult> ReceiveResult(const filter::ManifoldCall& call, SocketStream* from);

}  // namespace lumifold::device
