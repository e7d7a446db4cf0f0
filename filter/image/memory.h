#pragma once

namespace lumifold {

/// Asks the C library to keep the memory that this process frees for what it needs next. Filtering makes and
/// drops hundreds of planes; given back each time, every page of them costs a fault to get again. For
/// programs that filter a picture and end: a library does not decide for its process. The most memory in use
/// stays the same. Does nothing where the C library is not GNU's.
void KeepFreedMemory();

}  // namespace lumifold
