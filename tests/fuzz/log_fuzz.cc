// Lines of the log, which have text of others: how they are taken apart, and what they are as JSON. And trace
// contexts.

#include <nlohmann/json.hpp>

#include "proto/logging/fields.h"
#include "proto/logging/json_formatter.h"
#include "proto/rpc/trace_context.h"
#include "tests/fuzz/fuzz_target.h"

namespace lumifold::fuzz {
namespace {

constexpr size_t kMaxBytes = 2048;

void TryLine(const std::string& text) {
  const std::string line = logging::JsonLine({}, "info", text, kMaxBytes);
  if (line.size() > kMaxBytes || line.find('\n') != line.size() - 1) Fail("not one line", text);
  const nlohmann::json json = nlohmann::json::parse(line, nullptr, /*allow_exceptions=*/false);
  if (!json.is_object() || !json.contains("time") || !json.contains("event")) Fail("no object", text);
}

void TryValue(const std::string& text) {
  const logging::Line line = logging::ParseLine("event=e value=" + logging::Escaped(text) + " last=1");
  if (line.event != "e" || line.fields.size() != 2 || line.Get("value") != text || line.Get("last") != "1")
    Fail("another value", text);
}

void TryTrace(const std::string& text) {
  const std::string id = rpc::TraceIdOf(text);
  if (!id.empty() && (!rpc::IsTraceId(id) || text.find(id) != 3)) Fail("another trace", text);
  const std::string continued = rpc::TraceIdOf(rpc::ContinueTrace(text, [] { return uint64_t{1}; }));
  if (!rpc::IsTraceId(continued) || (!id.empty() && continued != id)) Fail("a trace is lost", text);
}

}  // namespace

std::vector<std::string> Seeds() {
  return {R"(event=unit_failed unit="j-1 frame 0 tile 3" worker=w-7/node:1 error="a \"b\" \303\244")",
          "event=e a=1 a=2 free text time=3", "event=\xff\xc3 \xe2\x82\xac=\"\\777\\x\"", "\"=\\ \n\t\x01x",
          "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01"};
}

}  // namespace lumifold::fuzz

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const std::string text(reinterpret_cast<const char*>(data), size);
  lumifold::fuzz::TryLine(text);
  lumifold::fuzz::TryValue(text);
  lumifold::fuzz::TryTrace(text);
  return 0;
}
