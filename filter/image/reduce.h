#pragma once

#include "filter/image/layered_image.h"

namespace lumifold {

/// A film of fewer pixels, each of which stands for a block of `factor` x `factor` pixels; smaller at the
/// right and lower border. Its channels are means over the samples of the block: layers and halves are
/// weighted by their sample counts, which are added up. Features are means over the pixels, but object ids
/// are those of the pixel in the block's middle. A picture without counts has the same for all pixels.
/// Shapes:  film W x H, channels as FilterFilm, or of a result; result ceil(W / factor) x ceil(H / factor),
///          the same channels.
/// `factor`: at least 1.
/// Threads: safe concurrently.
LayeredImage ReduceFilm(const LayeredImage& film, int factor);

}  // namespace lumifold
