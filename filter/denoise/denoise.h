#pragma once

#include <array>
#include <functional>
#include <limits>

#include "absl/functional/function_ref.h"
#include "filter/denoise/layer_filter.h"
#include "filter/image/layered_image.h"
#include "filter/image/parallel.h"
#include "filter/layers/product.h"

namespace lumifold::filter {

// The functions here take a film and its edge set as FilterFilm() in filter/methods.h describes them, all
// channels there; `edges` may be null.

/// What takes the noise out of one layer, given as halves about 1 and the features that guide it: see
/// FilterLayer.
using LayerFilter =
    absl::FunctionRef<FilteredLayer(Halves halves, const Planes& geometry, const SlicePoints* points)>;

/// The steps of the default method, in the order they end; kOtherLayers as often as there are layers.
enum class DenoiseStep {
  kSetUp,
  kDirect,
  kIndirect,
  kOtherLayers,  // gloss, mirrors and glass
  kRemainder,    // put together, and what the layers leave of C
  kEdgeMeans,    // T and E of edges, and light read at their sub-samples
  kRelighting,
  kRegression,
  kConvergence
};
inline constexpr size_t kDenoiseSteps = static_cast<size_t>(DenoiseStep::kConvergence) + 1;
/// Where it is set, told of each step that is through: for those who measure.
using StepWatch = std::function<void(DenoiseStep)>;

/// How FilterLayers() puts a picture together.
struct Assembly {
  bool has_levels = true;  // or mirrors and glass are filtered with what the layers leave of C
  /// Pixels of the edge set with more samples than this are not antialiased by light read at their
  /// sub-samples.
  float most_samples = std::numeric_limits<float>::infinity();
  Planes* edge_change = nullptr;  // not null: EdgeMeansChange() is added to the picture and stored there
  ProductParams products;         // how layers are taken from the film
  /// What the layers leave of C is guided by what is seen in mirrors and through glass, not by these.
  bool rest_sees_levels = false;
  StepWatch watch = nullptr;
};

/// Filters each layer of light the film has, and what they leave of C, by `filter`, and puts the picture
/// together again. Without edges `filter` is asked for no points and no edge is antialiased.
std::array<Plane, 3> FilterLayers(const LayeredImage& film, const LayeredImage* edges, LayerFilter filter,
                                  TaskPool* pool, const Assembly& assembly = {});

/// The parts of the default method. All are on but where what one of them is worth is measured.
struct DenoiseParts {
  bool patches = true;  // the NLM space; else geometry alone guides
  bool normals = true;  // among the features
  bool depth = true;
  bool edge_points = true;  // edges antialiased by their sub-samples
  bool levels = true;       // mirrors and glass filtered level by level
  bool fireflies = true;    // taken out before, and their energy spread
  bool first_order = true;  // planes fitted through the light, not means
  bool second_pass = true;
  bool choice = true;       // of the scale, per pixel by estimated error
  bool convergence = true;  // the result drawn back to C
  StepWatch watch = nullptr;
};

/// The default method: FilterLayer on each layer, T and E of edges steadied, pixels of several surfaces
/// relit, what is left on edges and in mirrors fitted, then the result drawn back to C where noise cannot
/// explain what they differ by.
std::array<Plane, 3> Denoise(const LayeredImage& film, const LayeredImage* edges, TaskPool* pool,
                             const DenoiseParts& parts = {});

/// The paper's own: FilterLayerOnce on each layer.
std::array<Plane, 3> DenoiseAsPublished(const LayeredImage& film, const LayeredImage* edges, TaskPool* pool);

}  // namespace lumifold::filter
