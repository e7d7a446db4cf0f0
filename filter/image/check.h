#pragma once

#include <cstdio>
#include <cstdlib>

/// Aborts the process with file, line and condition if an invariant is broken. Not for bad input: that is a
/// Status.
#define LUMIFOLD_CHECK(condition)                                                            \
  do {                                                                                       \
    if (!(condition)) [[unlikely]] {                                                         \
      std::fprintf(stderr, "%s:%d: broken invariant: %s\n", __FILE__, __LINE__, #condition); \
      std::abort();                                                                          \
    }                                                                                        \
  } while (false)
