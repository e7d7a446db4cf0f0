#include "filter/opencl/choice_run.h"

#include <algorithm>
#include <vector>

namespace lumifold::filter {
namespace {

using Buffer = KernelRun::Buffer;

constexpr uint64_t kTerms = 6;  // as choice.cl has them

uint64_t CellsOf(const LayerSizes& sizes) { return static_cast<uint64_t>(sizes.kinds) * sizes.cells; }

}  // namespace

ChoiceRun::ChoiceRun(const LayerCall& call, const LayerPlanes& layer, KernelRun* run)
    : call_(call), layer_(layer), sizes_(layer.sizes), run_(*run) {
  for (Buffer* const buffer : {&errors_, &kind_, &rough_, &smooth_}) *buffer = run_.Floats(sizes_.pixels);
  terms_ = run_.Floats(3 * sizes_.pixels);
  cells_ = run_.Floats(kTerms * CellsOf(sizes_));
  row_sums_ = run_.Floats(kTerms * CellsOf(sizes_));
  of_cells_ = run_.Floats(CellsOf(sizes_));
}

DeviceMemory ChoiceRun::Need(const LayerSizes& sizes) {
  const uint64_t pixels = sizes.pixels, cells = CellsOf(sizes);
  return Together({pixels, pixels, pixels, pixels, 3 * pixels, kTerms * cells, kTerms * cells, cells});
}

void ChoiceRun::WeighErrors(Buffer picture) {
  if (call_.halves.picture_light.IsEmpty())
    run_.Run("LightOf", sizes_.pixels,
             {sizes_.grid, 1.0f / (6.0f * call_.halves.level), picture, layer_.light});
  run_.Run("WeighErrors", sizes_.pixels,
           {sizes_.grid, call_.choice.dim, layer_.masks[0], layer_.masks[1], layer_.mixed, layer_.light,
            errors_, kind_});
  run_.Run("WeighErrorsOfPoints", layer_.points.runs,
           {sizes_.grid, call_.choice.dim, Int(layer_.points.runs), layer_.points.firsts,
            layer_.points.places, layer_.light, errors_, kind_});
}

void ChoiceRun::Move(Buffer picture, Buffer other, Buffer to, bool is_noisy) {
  const Grid& grid = sizes_.grid;
  run_.Run("TermsOfPixels", sizes_.pixels,
           {grid, picture, other, layer_.noisy, layer_.samples, layer_.expected, errors_, kind_, terms_});
  run_.Run("TermsOfPoints", layer_.points.runs,
           {grid, Int(layer_.points.runs), layer_.points.firsts, layer_.points.places, picture, other,
            layer_.noisy, layer_.points.weights, layer_.points.samples, errors_, terms_});
  CompareCells();
  run_.Run("ShareOfCells", sizes_.pixels, {grid, kind_, of_cells_, rough_});
  run_.Run("RefinePixels", sizes_.pixels,
           {grid, call_.choice.narrow_radius, call_.choice.significance, kind_, terms_, rough_});
  run_.Run("SmoothShare", sizes_.pixels,
           {grid, call_.choice.blend_radius, layer_.weight, kind_, rough_, smooth_});
  run_.Run("MoveTowards", sizes_.sites,
           {grid, is_noisy ? 1 : 0, layer_.points.places, layer_.points.shares[0], layer_.points.shares[1],
            smooth_, to, picture});
}

void ChoiceRun::CompareCells() {
  const Grid& grid = sizes_.grid;
  const uint64_t cells = CellsOf(sizes_);
  run_.Write(of_cells_, 0, std::vector<float>(cells).data(), cells * sizeof(float));
  run_.Run("TermsOfCells", sizes_.cells, {grid, sizes_.kinds, kind_, terms_, cells_});
  for (const int pixels : {call_.choice.widest_radius, call_.choice.wide_radius}) {
    // As BoxMeans: a window over the whole picture reaches no further.
    const int32_t radius = std::min(pixels / kChoiceCell, std::max(grid.columns, grid.rows));
    run_.Run("SumRowsOfCells", kTerms * cells, {grid, Int(kTerms) * sizes_.kinds, radius, cells_, row_sums_});
    run_.Run("RefineCells", cells,
             {grid, sizes_.kinds, radius, call_.choice.significance, row_sums_, of_cells_});
  }
}

}  // namespace lumifold::filter
