#pragma once

// Debian's libdraco contains an older tinygltf with the same symbols, which the linker would mix with ours.
// Ours is therefore compiled from its header (tinygltf.cc) in a namespace of another name. It needs no image
// library, because images.h decodes the pictures, and may open no file: what a scene names is read by an
// AssetReader.
#define TINYGLTF_NO_STB_IMAGE
#define TINYGLTF_NO_STB_IMAGE_WRITE
#define TINYGLTF_NO_EXTERNAL_IMAGE
#define TINYGLTF_NO_FS
#define tinygltf lumifold_tinygltf
#include <tiny_gltf.h>
#undef tinygltf

namespace tinygltf = lumifold_tinygltf;
