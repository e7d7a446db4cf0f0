#pragma once

#include <memory>

#include "filter/image/layered_image.h"
#include "worker/render/lights/environment.h"

/// The light of scenes that have none: a neutral photographer's studio, for product models.
namespace lumifold::render {

/// The studio as a latitude-longitude picture of grey values: a soft key light at the upper left of the
/// front (+Z), a large fill light at the right, a rim light high behind (out of sight of level cameras),
/// and walls and a floor that darken downwards. A white diffuse surface that faces the front is about as
/// bright as white paper.
LayeredImage StudioPicture();

/// The environment of StudioPicture, made once.
std::shared_ptr<const Environment> StudioEnvironment();

}  // namespace lumifold::render
