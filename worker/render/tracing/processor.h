#pragma once

#include <cstdint>

namespace lumifold::render {

/// The instruction set that Embree uses, part of the numeric class. On x86-64: "avx2" if the processor has
/// it, else "sse4.2"; on arm64: "neon".
const char* TracingInstructionSet();

/// Identifies the bits that the processor's approximate reciprocal and reciprocal square root give (x86-64:
/// rcpps, rsqrtps; arm64: frecpe, frsqrte). The instruction set leaves them open, makers of processors
/// differ, and Embree refines what it gets from them, so that hits differ in their last bits too.
uint16_t ApproximationsOfProcessor();

/// While it exists, this thread rounds to nearest and treats denormals as zero, because they are slow and
/// Embree requires it. The destructor restores the previous state, so that a host program's settings neither
/// change the picture nor are changed.
class ScopedFloatEnvironment {
 public:
  ScopedFloatEnvironment();
  ~ScopedFloatEnvironment();
  ScopedFloatEnvironment(const ScopedFloatEnvironment&) = delete;
  ScopedFloatEnvironment& operator=(const ScopedFloatEnvironment&) = delete;

 private:
  uint64_t saved_;
};

}  // namespace lumifold::render
