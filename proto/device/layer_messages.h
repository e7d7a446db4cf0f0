#pragma once

#include <array>
#include <optional>
#include <vector>

#include "filter/manifold/filter_device.h"
#include "proto/device/call_messages.h"
#include "proto/device/socket_stream.h"

namespace lumifold::device {

// Layers of filter::FilterDevice, as call_messages.h has filterings.

/// Lists of filter::PointsOfLayer.
struct ReceivedLists {
  std::array<std::vector<float>, 2> uncut, coverage;
  std::vector<float> offsets, weights, samples;
};

/// A layer, and what it refers to.
struct ReceivedLayer {
  filter::LayerCall call;  // without planes, points and lists
  Planes planes;
  std::array<bool, 3> has = {};  // those that may be empty: light of the picture, difference, mixed pixels
  size_t geometry = 0;
  std::vector<filter::SlicePoints> points;  // of both halves; or none
  ReceivedLists lists;

  filter::LayerCall View() const;
};

/// Whether a layer is within the limits of what is received.
bool CanSend(const filter::LayerCall& call);
/// With its operation.
bool SendLayer(const filter::LayerCall& call, SocketStream* to);
/// After the operation. nullopt: the other end is closed, or this is no layer with two halves.
std::optional<ReceivedLayer> ReceiveLayer(SocketStream* from);

bool SendResult(const filter::LayerResult& result, SocketStream* to);
std::optional<filter::LayerResult> ReceiveResult(const filter::LayerCall& call, SocketStream* from);

}  // namespace lumifold::device
