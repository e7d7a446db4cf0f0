#include "worker/render/tracing/processor.h"

#include <gtest/gtest.h>

#include <string>

#include "worker/render/renderer.h"

namespace lumifold::render {
namespace {

TEST(Approximations, ArePartOfTheNumericClass) {
  const std::string name = NumericClass();
  const size_t dash = name.rfind('-');
  ASSERT_NE(dash, std::string::npos);
  EXPECT_EQ(std::stoul(name.substr(dash + 1), nullptr, 16), ApproximationsOfProcessor());
}

}  // namespace
}  // namespace lumifold::render
