#include "proto/threads/end_process.h"

#include <cstdio>
#include <cstdlib>
#include <iostream>

namespace lumifold::threads {

void EndProcess(int code) {
  std::cout.flush();
  std::cerr.flush();
  std::fflush(nullptr);
  std::_Exit(code);
}

}  // namespace lumifold::threads
