#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "absl/types/span.h"
#include "filter/manifold/filter_device.h"
#include "proto/device/socket_stream.h"

namespace lumifold::device {

// Calls of filter::FilterDevice and their results between two processes of one program on one machine. The
// process with the device is in no sandbox, the caller may be a sandboxed one that a malformed scene has
// taken over: what is received of calls is checked.

/// What a message asks for; it comes first.
enum class Operation : uint32_t { kFilter, kFit, kRefine };
/// nullopt: the other end is closed, or there is none such.
std::optional<Operation> ReceiveOperation(SocketStream* from);

/// Planes that a caller's calls send once: as filter::FilterDevice::Keep says.
class SentPlanes {
 public:
  void Keep(absl::Span<const ConstFloatView> planes);
  void Forget(absl::Span<const ConstFloatView> planes);

  /// Of a plane that is kept, from 1; 0: this one is not. `is_there`: it has been sent.
  uint32_t NumberOf(const ConstFloatView& plane, bool* is_there) const;
  /// All that are kept have been sent where `planes` have.
  void SetSent(absl::Span<const ConstFloatView> planes);
  /// Numbers of planes that the other end has and may forget.
  std::vector<uint32_t> TakeForgotten() { return std::exchange(forgotten_, {}); }

 private:
  struct Kept {
    uint32_t number = 0;
    uint64_t floats = 0;
    bool is_there = false;
  };
  std::map<const float*, Kept> kept_;  // by the first pixel
  uint64_t floats_ = 0;                // of all
  uint32_t last_ = 0;                  // number
  std::vector<uint32_t> forgotten_;
};

/// Those of a connection at the other end, by numbers.
using KeptPlanesOfCaller = std::map<uint32_t, Plane>;

/// Calls, and what they refer to. Planes and points that several share are here once.
struct ReceivedCalls {
  struct Part {
    std::vector<uint32_t> planes;  // numbers: of signals, bases, colours of patches, features and the mask
    std::vector<float> taps;
    float scale = 1;
    uint32_t points = 0;  // their number, from 1; 0: none
  };

  Planes planes;  // that are not kept
  std::vector<filter::SlicePoints> points;
  filter::PlaneViews views;  // of all, by numbers
  filter::ManifoldParams params;
  float reach = 1;
  size_t signals = 0, bases = 0, colors = 0;
  int radius = 0, dimensions = 0;
  float inverse_knee = 0, shift = 0;
  std::vector<Part> parts;
  filter::PlaneViews others;  // that the message has besides; some may be empty

  std::vector<filter::ManifoldCall> View() const;
};

/// Whether calls are within the limits of what is received.
bool CanSend(absl::Span<const filter::ManifoldCall> calls);
/// With its operation.
bool SendCalls(absl::Span<const filter::ManifoldCall> calls, SentPlanes* kept, SocketStream* to);
/// Without, for messages that have more. `others`: planes of their size, some of which may be empty.
bool SendCallsAnd(const filter::PlaneViews& others, absl::Span<const filter::ManifoldCall> calls,
                  SentPlanes* kept, SocketStream* to);
/// What either sends, after the operation. nullopt: the other end is closed, or these are no calls that
/// ManifoldFilterAtPoints and ProjectPatches take. The calls refer to `kept`.
std::optional<ReceivedCalls> ReceiveCalls(KeptPlanesOfCaller* kept, SocketStream* from);

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
