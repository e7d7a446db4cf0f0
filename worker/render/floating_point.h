#pragma once

#include <immintrin.h>

namespace lumifold::render {

/// While it lives, this thread rounds to nearest and treats denormals as zero: they are slow, and Embree
/// wants it so. The state found is put back, so that a host program's settings neither change the picture nor
/// suffer from it.
class ScopedFloatEnvironment {
 public:
  ScopedFloatEnvironment() : saved_(_mm_getcsr()) {
    _mm_setcsr(kMaskedExceptions | kFlushToZero | kDenormalsAreZero);
  }
  ~ScopedFloatEnvironment() { _mm_setcsr(saved_); }
  ScopedFloatEnvironment(const ScopedFloatEnvironment&) = delete;
  ScopedFloatEnvironment& operator=(const ScopedFloatEnvironment&) = delete;

 private:
  static constexpr unsigned kMaskedExceptions = 0x1f80;
  static constexpr unsigned kFlushToZero = 0x8000;
  static constexpr unsigned kDenormalsAreZero = 0x0040;
  unsigned saved_;
};

}  // namespace lumifold::render
