#define TINYGLTF_IMPLEMENTATION
#include "worker/scene/tinygltf.h"
