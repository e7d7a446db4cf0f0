#include "proto/rpc/trace_context.h"

#include <grpcpp/server_context.h>

#include <algorithm>
#include <random>

#include "absl/strings/str_cat.h"

namespace lumifold::rpc {
namespace {

// "00-<32 digits: trace>-<16 digits: sender>-<2 digits: flags>"
constexpr size_t kVersionEnd = 2;
constexpr size_t kTraceEnd = kVersionEnd + 1 + 32;
constexpr size_t kSenderEnd = kTraceEnd + 1 + 16;
constexpr size_t kBytes = kSenderEnd + 1 + 2;
/// Recorded by its sender.
constexpr std::string_view kSampled = "01";

bool IsHex(std::string_view text) {
  return std::all_of(text.begin(), text.end(),
                     [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); });
}

bool IsId(std::string_view text) {
  return IsHex(text) && text.find_first_not_of('0') != std::string_view::npos;
}

bool IsTraceParent(std::string_view text) {
  if (text.size() < kBytes) return false;
  const std::string_view version = text.substr(0, kVersionEnd);
  if (!IsHex(version) || version == "ff" || (version == "00" && text.size() != kBytes)) return false;
  if (text.size() > kBytes && text[kBytes] != '-') return false;
  for (const size_t end : {kVersionEnd, kTraceEnd, kSenderEnd}) {
    if (text[end] != '-') return false;
  }
  return IsId(text.substr(kVersionEnd + 1, kTraceEnd - kVersionEnd - 1)) &&
         IsId(text.substr(kTraceEnd + 1, kSenderEnd - kTraceEnd - 1)) &&
         IsHex(text.substr(kSenderEnd + 1, 2));
}

/// 16 digits, not all of them 0.
std::string HexOf(const std::function<uint64_t()>& random) {
  return absl::StrCat(absl::Hex(std::max<uint64_t>(1, random()), absl::kZeroPad16));
}

std::string Compose(std::string_view trace_id, std::string_view flags,
                    const std::function<uint64_t()>& random) {
  return absl::StrCat("00-", std::string(trace_id), "-", HexOf(random), "-", std::string(flags));
}

}  // namespace

bool IsTraceId(std::string_view text) { return text.size() == kTraceEnd - kVersionEnd - 1 && IsId(text); }

std::string TraceIdOf(std::string_view traceparent) {
  if (!IsTraceParent(traceparent)) return "";
  return std::string(traceparent.substr(kVersionEnd + 1, kTraceEnd - kVersionEnd - 1));
}

uint64_t SystemRandom() {
  std::random_device source;
  return std::uniform_int_distribution<uint64_t>()(source);
}

std::string MakeTraceId(const std::function<uint64_t()>& random) { return HexOf(random) + HexOf(random); }

std::string MakeTraceParent(std::string_view trace_id, const std::function<uint64_t()>& random) {
  return Compose(trace_id, kSampled, random);
}

std::string ContinueTrace(std::string_view received, const std::function<uint64_t()>& random) {
  const std::string trace_id = TraceIdOf(received);
  if (trace_id.empty()) return MakeTraceParent(MakeTraceId(random), random);
  return Compose(trace_id, received.substr(kSenderEnd + 1, 2), random);
}

std::string SentTraceParent(const grpc::ServerContextBase& context) {
  const auto found = context.client_metadata().find(kTraceParentKey);
  if (found == context.client_metadata().end()) return "";
  const std::string_view sent(found->second.data(), found->second.size());
  return IsTraceParent(sent) ? std::string(sent) : "";
}

}  // namespace lumifold::rpc
