#pragma once

#include <vector>

#include "absl/status/status.h"
#include "worker/scene/document.h"

namespace lumifold::scene {

/// Reads the materials `in_use` (same indices as in the file) and the textures and images that they use,
/// each decoded once, into `scene`. Factors out of range are clamped and counted; textures that the
/// renderer does not use are counted. Errors: kInvalidArgument, kResourceExhausted, the reader's own; each
/// names the material, texture or image.
absl::Status ReadMaterials(const Document& document, const std::vector<bool>& in_use,
                           const AssetReader& reader, const LoadOptions& options, Scene* scene,
                           Diagnostics* diagnostics);

}  // namespace lumifold::scene
