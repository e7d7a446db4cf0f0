#include "worker/render/tracing/processor.h"

#include <bit>

#if defined(__x86_64__)
#include <immintrin.h>
#elif defined(__aarch64__)
#include <arm_neon.h>
#else
#error "Embree knows x86-64 and arm64 only: another processor needs its instructions and a numeric class"
#endif

namespace lumifold::render {
namespace {

#if defined(__x86_64__)

constexpr uint64_t kMaskedExceptions = 0x1f80;
constexpr uint64_t kFlushToZero = 0x8000;
constexpr uint64_t kDenormalsAreZero = 0x0040;
constexpr uint64_t kFloatEnvironment = kMaskedExceptions | kFlushToZero | kDenormalsAreZero;

uint64_t FloatEnvironment() { return _mm_getcsr(); }
void SetFloatEnvironment(uint64_t state) { _mm_setcsr(static_cast<unsigned>(state)); }

float ApproximateReciprocal(float x) { return _mm_cvtss_f32(_mm_rcp_ps(_mm_set1_ps(x))); }
float ApproximateReciprocalRoot(float x) { return _mm_cvtss_f32(_mm_rsqrt_ps(_mm_set1_ps(x))); }

#else

/// Of the register FPCR: flush to zero, with which operands count as zero too. All other bits 0: round to
/// nearest, no traps.
constexpr uint64_t kFloatEnvironment = uint64_t{1} << 24;

uint64_t FloatEnvironment() {
  uint64_t state = 0;
  asm volatile("mrs %0, fpcr" : "=r"(state));
  return state;
}
void SetFloatEnvironment(uint64_t state) { asm volatile("msr fpcr, %0" : : "r"(state)); }

float ApproximateReciprocal(float x) { return vrecpes_f32(x); }
float ApproximateReciprocalRoot(float x) { return vrsqrtes_f32(x); }

#endif

/// The results depend on the high bits of the mantissa and, for the root, on the lowest bit of the exponent:
/// these inputs cover [1, 4) in steps of 2^-13 and 2^-12.
constexpr uint32_t kFirst = std::bit_cast<uint32_t>(1.0f);
constexpr uint32_t kEnd = std::bit_cast<uint32_t>(4.0f);
constexpr uint32_t kStep = 1u << 10;

uint16_t MeasureApproximations() {
  uint64_t hash = 0xcbf29ce484222325u;  // FNV-1a, of whole words
  const auto add = [&hash](float value) { hash = (hash ^ std::bit_cast<uint32_t>(value)) * 0x100000001b3u; };
  for (uint32_t bits = kFirst; bits < kEnd; bits += kStep) {
    add(ApproximateReciprocal(std::bit_cast<float>(bits)));
    add(ApproximateReciprocalRoot(std::bit_cast<float>(bits)));
  }
  return static_cast<uint16_t>(hash >> 48);
}

}  // namespace

const char* TracingInstructionSet() {
#if defined(__x86_64__)
  return __builtin_cpu_supports("avx2") ? "avx2" : "sse4.2";
#else
  return "neon";
#endif
}

uint16_t ApproximationsOfProcessor() {
  static const uint16_t identity = MeasureApproximations();
  return identity;
}

ScopedFloatEnvironment::ScopedFloatEnvironment() : saved_(FloatEnvironment()) {
  SetFloatEnvironment(kFloatEnvironment);
}
ScopedFloatEnvironment::~ScopedFloatEnvironment() { SetFloatEnvironment(saved_); }

}  // namespace lumifold::render
