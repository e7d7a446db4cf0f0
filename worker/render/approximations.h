#pragma once

#include <cstdint>

namespace lumifold::render {

/// Identifies the bits that the processor's approximate reciprocal and reciprocal square root (rcpps, rsqrtps) give. The
/// instruction set leaves them open, makers of processors differ, and Embree refines what it gets from them, so that
/// hits differ in their last bits too.
uint16_t ApproximationsOfProcessor();

}  // namespace lumifold::render
