#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "absl/types/span.h"
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

/// Calls, and what they refer to. Planes and points that several share are here once.
struct ReceivedCalls {
  struct Part {
    std::vector<uint32_t> planes;  // numbers: of signals, colours of patches, features and the mask
    std::vector<float> taps;
    float scale = 1;
    uint32_t points = 0;  // their number, from 1; 0: none
  };

  Planes planes;
  std::vector<filter::SlicePoints> points;
  filter::ManifoldParams params;
  float reach = 1;
  size_t signals = 0, colors = 0;
  int radius = 0, dimensions = 0;
  std::vector<Part> parts;

  std::vector<filter::ManifoldCall> View() const;
};

/// Whether calls are within the limits of what is received.
bool CanSend(absl::Span<const filter::ManifoldCall> calls);
/// With its operation.
bool SendCalls(absl::Span<const filter::ManifoldCall> calls, SocketStream* to);
/// What SendCalls() sends, after the operation. nullopt: the other end is closed, or these are no calls that
/// ManifoldFilterAtPoints and ProjectPatches take.
std::optional<ReceivedCalls> ReceiveCalls(SocketStream* from);

/// What is sent before a result: whether there is one, or the device leaves the call to the caller's
/// processor.
bool SendHasResult(bool has_result, SocketStream* to);
/// nullopt: the other end is closed.
std::optional<bool> ReceiveHasResult(SocketStream* from);
bool SendResults(const std::vector<filter::ManifoldResult>& results, SocketStream* to);
/// The results of `calls`.
std::optional<std::vector<filter::ManifoldResult>> ReceiveResults(
    absl::Span<const filter::ManifoldCall> calls, SocketStream* from);

}  // namespace lumifold::device
