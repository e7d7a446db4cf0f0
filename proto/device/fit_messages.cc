#include "proto/device/fit_messages.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>

#include "proto/device/call_messages.h"
#include "proto/device/message_parts.h"

namespace lumifold::device {
namespace {

constexpr uint32_t kMostSampleFloats = 1U << 28;  // 1536 x 1536 pixels with three samples each

struct FitHeader {
  int32_t width, height, radius;
  int32_t terms, signals, traits;
  float falloff, slope;
  uint32_t samples, targets;
};

FitHeader HeaderOf(const filter::FitCall& call) {
  const filter::FitShape& shape = call.shape;
  return {call.width,
          call.height,
          call.radius,
          shape.terms,
          shape.signals,
          shape.traits,
          call.falloff,
          call.slope,
          static_cast<uint32_t>(call.Count()),
          static_cast<uint32_t>(call.targets.size())};
}

filter::FitShape ShapeOf(const FitHeader& header) { return {header.terms, header.signals, header.traits}; }

bool IsValid(const FitHeader& header) {
  const auto is_count = [](int32_t count) { return count >= 1 && IsCount(static_cast<uint32_t>(count)); };
  return IsSize(header.width, header.height) && header.radius >= 0 && header.radius <= kMostRadius &&
         is_count(header.terms) && is_count(header.signals) && is_count(header.traits) &&
         header.traits % 4 == 0 && std::isfinite(header.falloff) && std::isfinite(header.slope) &&
         header.samples <= kMostSampleFloats / static_cast<uint32_t>(ShapeOf(header).Sample()) &&
         header.targets <= header.samples;
}

/// Whether kernels stay within the lists of a call whose header is valid.
bool HasValidLists(const filter::FitCall& call) {
  const auto& firsts = call.firsts;
  const auto is_number = [&](int32_t i) { return i >= 0 && static_cast<size_t>(i) < call.Count(); };
  return firsts.front() == 0 && static_cast<size_t>(firsts.back()) == call.Count() &&
         std::is_sorted(firsts.begin(), firsts.end()) &&
         std::is_sorted(call.targets.begin(), call.targets.end(), std::less_equal<>()) &&
         std::all_of(call.targets.begin(), call.targets.end(), is_number);
}

}  // namespace

filter::FitCall ReceivedFit::View() const {
  filter::FitCall view = call;
  view.firsts = firsts;
  view.samples = samples;
  view.targets = targets;
  return view;
}

bool CanSend(const filter::FitCall& call) { return IsValid(HeaderOf(call)); }

bool SendFit(const filter::FitCall& call, SocketStream* to) {
  const FitHeader header = HeaderOf(call);
  return SendOperation(Operation::kFit, to) && to->Write(&header, sizeof(header)) &&
         SendList(call.firsts, to) && SendList(call.samples, to) && SendList(call.targets, to);
}

std::optional<ReceivedFit> ReceiveFit(SocketStream* from) {
  FitHeader header = {};
  if (!from->Read(&header, sizeof(header)) || !IsValid(header)) return std::nullopt;
  ReceivedFit fit;
  fit.call = {.shape = ShapeOf(header),
              .width = header.width,
              .height = header.height,
              .radius = header.radius,
              .falloff = header.falloff,
              .slope = header.slope,
              .firsts = {},
              .samples = {},
              .targets = {}};
  const auto row = static_cast<size_t>(header.width);
  const size_t pixels = row * static_cast<size_t>(header.height);
  const auto of_sample = static_cast<size_t>(fit.call.shape.Sample());
  if (!ReceiveList(pixels + 1, from, &fit.firsts) ||
      !ReceiveList(header.samples * of_sample, from, &fit.samples) ||
      !ReceiveList(header.targets, from, &fit.targets) || !HasValidLists(fit.View()))
    return std::nullopt;
  for (size_t pixel = 0; pixel < pixels; ++pixel) {
    for (auto i = static_cast<size_t>(fit.firsts[pixel]); i < static_cast<size_t>(fit.firsts[pixel + 1]);
         ++i) {
      float* const end = fit.samples.data() + (i + 1) * of_sample;
      const size_t x = pixel % row, y = pixel / row;
      end[-2] = static_cast<float>(x);
      end[-1] = static_cast<float>(y);
    }
  }
  return fit;
}

bool SendResult(const filter::FitResult& result, SocketStream* to) {
  return SendList(result.values, to) && SendList(result.totals, to);
}

std::optional<filter::FitResult> ReceiveResult(const filter::FitCall& call, SocketStream* from) {
  filter::FitResult result;
  const size_t count = call.targets.size();
  if (!ReceiveList(count * static_cast<size_t>(call.shape.signals), from, &result.values) ||
      !ReceiveList(count, from, &result.totals))
    return std::nullopt;
  return result;
}

}  // namespace lumifold::device
