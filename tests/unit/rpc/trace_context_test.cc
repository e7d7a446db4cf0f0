#include "proto/rpc/trace_context.h"

#include <gtest/gtest.h>

#include <random>
#include <string>

namespace lumifold::rpc {
namespace {

constexpr char kTrace[] = "4bf92f3577b34da6a3ce929d0e0e4736";
constexpr char kParent[] = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-00";

std::function<uint64_t()> Random() {
  return [random = std::make_shared<std::mt19937_64>(7)] { return (*random)(); };
}

TEST(TraceContext, ReadsTheTraceIdOfATraceParent) {
  EXPECT_EQ(TraceIdOf(kParent), kTrace);
  EXPECT_EQ(TraceIdOf("00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-ff"), kTrace);
  EXPECT_EQ(TraceIdOf("cc-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01-what-comes-later"), kTrace);
}

TEST(TraceContext, TakesNoOther) {
  for (const char* malformed : {
           "",
           "00",
           "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7",
           "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-0",
           "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01-",
           "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-0x",
           "cc-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-012",
           "ff-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01",
           "0x-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01",
           "00-4BF92F3577B34DA6A3CE929D0E0E4736-00f067aa0ba902b7-01",
           "00-00000000000000000000000000000000-00f067aa0ba902b7-01",
           "00-4bf92f3577b34da6a3ce929d0e0e4736-0000000000000000-01",
           "00_4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01",
           "00-4bf92f3577b34da6a3ce929d0e0e4736_00f067aa0ba902b7-01",
           "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7_01",
           "00-4bf92f3577b34da6a3ce929d0e0e473\n-00f067aa0ba902b7-01",
       })
    EXPECT_EQ(TraceIdOf(malformed), "") << malformed;
}

TEST(TraceContext, ContinuesATraceUnderAnotherSender) {
  const std::string continued = ContinueTrace(kParent, Random());
  EXPECT_EQ(TraceIdOf(continued), kTrace);
  EXPECT_NE(continued, kParent);
  EXPECT_TRUE(continued.ends_with("-00")) << "the flags of the caller";
}

TEST(TraceContext, BeginsANewTraceWhereThereIsNone) {
  const auto random = Random();
  const std::string first = TraceIdOf(ContinueTrace("", random));
  const std::string second = TraceIdOf(ContinueTrace("00-nonsense", random));
  EXPECT_TRUE(IsTraceId(first));
  EXPECT_TRUE(IsTraceId(second));
  EXPECT_NE(first, second);
}

TEST(TraceContext, AnIdIsNeverZero) {
  const auto zero = [] { return uint64_t{0}; };
  EXPECT_TRUE(IsTraceId(MakeTraceId(zero)));
  EXPECT_EQ(TraceIdOf(MakeTraceParent(kTrace, zero)), kTrace);
  EXPECT_FALSE(IsTraceId(std::string(32, '0')));
  EXPECT_FALSE(IsTraceId("4bf9"));
}

}  // namespace
}  // namespace lumifold::rpc
