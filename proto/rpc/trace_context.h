#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

namespace grpc {
class ServerContextBase;
}  // namespace grpc

/// Trace ids as in W3C Trace Context: what one command causes is found by one id, in the logs of all
/// programs.
namespace lumifold::rpc {

/// Key of a traceparent in the metadata of calls.
inline constexpr char kTraceParentKey[] = "traceparent";

/// 32 lower-case hexadecimal digits, not all of them 0.
bool IsTraceId(std::string_view text);

/// The trace id of a traceparent; empty if it is not well-formed. Of versions after 00 only the part that 00
/// has counts.
std::string TraceIdOf(std::string_view traceparent);

/// 64 bits of the system's source, for `random` below.
uint64_t SystemRandom();
/// `random`: 64 random bits each call.
std::string MakeTraceId(const std::function<uint64_t()>& random);
/// A traceparent of this trace, with a new id of its sender.
std::string MakeTraceParent(std::string_view trace_id, const std::function<uint64_t()>& random);
/// What a program sends that was started with `received`: the same trace and flags, with a new id of the
/// sender. A new trace where `received` is not well-formed, such as empty.
std::string ContinueTrace(std::string_view received, const std::function<uint64_t()>& random);

/// The traceparent that the caller has sent; empty if it has sent none, or one that is not well-formed.
std::string SentTraceParent(const grpc::ServerContextBase& context);

}  // namespace lumifold::rpc
