#include "filter/image/memory.h"

#include <cstdlib>

#ifdef __GLIBC__
#include <malloc.h>
#endif

namespace lumifold {

void KeepFreedMemory() {
#ifdef __GLIBC__
  constexpr int kLargestFromHeap = 32 << 20;  // glibc's upper limit; the planes of a block are smaller
  mallopt(M_MMAP_THRESHOLD, kLargestFromHeap);
  mallopt(M_TRIM_THRESHOLD, -1);  // never
#endif
}

void UseArenas([[maybe_unused]] int most) {
#ifdef __GLIBC__
  mallopt(M_ARENA_MAX, most);
#endif
}

}  // namespace lumifold
