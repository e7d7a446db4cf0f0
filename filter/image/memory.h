#pragma once

namespace lumifold {

/// Makes the C library keep freed memory for later allocations. Filtering allocates and frees hundreds of
/// planes; if their memory went back to the system each time, every page would cost a page fault again. It
/// affects the whole process, so only programs that filter a picture and exit call it. Peak memory stays the
/// same. Does nothing unless the C library is GNU's.
void KeepFreedMemory();

/// Makes the C library serve all threads from so many arenas at most, >= 1. Each reserves 64 MiB of
/// addresses, and where these are limited a thread without one tries to reserve them at every allocation.
/// Call it before threads start. Does nothing unless the C library is GNU's.
void UseArenas(int most);

}  // namespace lumifold
