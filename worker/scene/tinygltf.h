#pragma once

// Debian's libdraco carries an older tinygltf under the same names, and the linker would mix the two: ours is
// compiled from its header (tinygltf.cc), under a name of its own. Pictures are ours to decode, so it needs
// no picture library.
#define TINYGLTF_NO_STB_IMAGE
#define TINYGLTF_NO_STB_IMAGE_WRITE
#define TINYGLTF_NO_EXTERNAL_IMAGE
#define tinygltf lumifold_tinygltf
#include <tiny_gltf.h>
#undef tinygltf

namespace tinygltf = lumifold_tinygltf;
