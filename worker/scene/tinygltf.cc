#include <fstream>  // tinygltf 2.7 leaves it out where it has no file system, and uses it

#define TINYGLTF_IMPLEMENTATION
#include "worker/scene/tinygltf.h"
