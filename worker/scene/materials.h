#pragma once

#include "absl/status/status.h"
#include "worker/scene/document.h"

namespace lumifold::scene {

/// Fills materials (same indices as in the file), and the textures and images they use, each decoded once, of
/// `scene`. Factors outside their range are clamped and counted; textures the renderer does not use are
/// counted. Errors: kInvalidArgument, kResourceExhausted, the reader's own; each naming the material, texture
/// or image.
absl::Status ReadMaterials(const Document& document, const AssetReader& reader, const LoadLimits& limits,
                           Scene* scene, Diagnostics* diagnostics);

}  // namespace lumifold::scene
