#pragma once

#include <immintrin.h>

namespace lumifold::render {

/// While it exists, this thread rounds to nearest and treats denormals as zero, because they are slow and
/// Embree requires it. The destructor restores the previous state, so that a host program's settings neither
/// change the picture nor are changed.
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
