#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace lumifold::filter {

// The inner loops of the filter, over one strip of one row of pixels or cells. They run with the widest
// vectors of the processor, chosen at run time, and give the same bits with any width: no multiply-add is
// fused, and no order of summation depends on the width. A cell's pixels are added row by row, in a row four
// by four, and four as two pairs. Each kernel is equal to the last bit to an oracle of the tests. Strips
// begin at a multiple of kStripColumns; rows may be read and written up to the next multiple of kRowPadding
// floats, as Plane allows. All are safe to run concurrently.

/// Greatest number of columns of pixels that one call works on: its sums stay in the cache, yet rows of cells
/// are long enough for hardware prefetching. A multiple of every cell's side.
inline constexpr int kStripColumns = 1024;
/// Floats to which rows are padded.
inline constexpr int kRowPadding = 16;
/// Floats that may be read (not used) after the last cell of a row of cells.
inline constexpr int kCellPadding = 32;

/// How pixels lie between cells of `step` pixels. Rows of pixels are ordered by phase: first the first pixel
/// of each cell, then the second, each phase padded. So the pixels of a vector all lie alike between their
/// cells and the next ones, and what they read from cells follows each other. Pixels of phase j lie `part[j]`
/// of the way from cell c - 1 + Side(j) to the one after.
struct Phases {
  explicit Phases(int cell_step);
  int Side(int phase) const { return phase >= step / 2 ? 1 : 0; }

  int step;  // a power of two up to 64
  std::array<float, 64> part;
};

/// Rows of cells between two others: out[p] = upper[p] + fraction (lower[p] - upper[p]) for each of `planes`
/// planes, where upper and lower are two rows of the same plane, and p runs from `first` over `count` cells,
/// clamped to [0, columns).
struct BlendArgs {
  const float* const* upper;
  const float* const* lower;
  float fraction;
  size_t planes;
  int first;  // -1 at the left edge
  int count;
  int columns;
  float* out;  // plane i at out + i * out_stride
  size_t out_stride;
};

/// One row of pixels and one manifold.
struct WeighArgs {
  const float* const* features;  // d rows of pixels
  const float* eta;              // d rows of cells, from one before the strip's first: the manifold
  size_t eta_stride;
  size_t dimensions;
  float* weight;                // out: exp(-squared distance from the manifold)
  float* total;                 // += weight
  std::ptrdiff_t phase_stride;  // from one phase of the pixels to the next
  int count;                    // cells
};

/// How the manifold's cluster is split in two.
struct SplitArgs {
  const float* axis;  // d
  float cluster;      // label of the manifold's own pixels
  const float* labels;
  float* members;           // membership of each pixel in its cluster: lowered near the split
  float* next_labels;       // out, own pixels only: 2 * cluster, + 1 on the axis' side
  float* const* near_sums;  // d + 1 strips of cluster 2 * cluster: += member * (1 - weight) * feature, and
                            // without feature
  float* const* far_sums;   // the same of cluster 2 * cluster + 1
};

/// A row of pixels, or points, on one manifold.
struct SplatArgs {
  const float* const* signals;  // C rows
  size_t signal_count;
  const float* mask;
  const float* weight;
  float* const* sums;           // C + 1 strips: += mask * weight * signal, and of mask * weight
  std::ptrdiff_t phase_stride;  // of the pixels
  int count;                    // cells
};

/// One row of pixels sliced from manifolds.
struct SliceArgs {
  const float* const* weights;  // M rows of pixels
  size_t manifolds;
  const float* psi;  // M * planes rows of cells, manifold by manifold, from one before the strip's first
  size_t psi_stride;
  size_t planes;
  float* const* sums;           // `planes` rows of pixels: sum over manifolds of weight * psi
  bool adds;                    // to what is in them
  std::ptrdiff_t phase_stride;  // of the pixels
  int count;                    // cells
};

/// Points of one row of pixels, at any place of a strip. Point i lies `part[i]` of the way from cell
/// `left[i]` of a row of cells to the next one, in cell `own[i]` of the strip.
struct PointCells {
  const int32_t* left;
  const float* part;
  const int32_t* own;
  int count;
};

void BlendCells(const BlendArgs& args);
/// Whether any pixel belongs to the cluster. `split` may be null: none does.
bool WeighRow(const Phases& phases, const WeighArgs& args, const SplitArgs* split);
/// Whether any pixel has weight.
bool SplatRow(int step, const SplatArgs& args);
void SliceRow(const Phases& phases, const SliceArgs& args);
/// The same at points: rows of `args` are of points, and its phases and counts of cells do not matter. The
/// squared distance over the first `shared` features is divided by `divisor`.
void WeighPoints(const PointCells& cells, const WeighArgs& args, size_t shared, float divisor);
bool SplatPoints(const PointCells& cells, const SplatArgs& args);
void SliceAtPoints(const PointCells& cells, const SliceArgs& args);
/// sums[x] += a[x] * b[x], rows of pixels.
void AddProductRow(const float* a, const float* b, int count, float* sums);
/// sums[x] /= total[x]; instead[x] where the total is below `least`.
void QuotientRow(const float* total, float least, const float* instead, int count, float* sums);
/// Rows of pixels under a window: `rows` of them, and `row_taps` factors for each, one row's after another's.
struct CorrelateArgs {
  const float* taps;
  int row_taps;
  const float* const* pixels;
  size_t rows;
  int count;
};
/// out[x] = sum over rows and taps j of taps[row][j] * pixels[row][x + j], row after row, added in groups of
/// three taps, each group from the left.
void CorrelateRows(const CorrelateArgs& args, float* out);
/// The same bits a pixel at a time, for rows that are narrower than a vector.
void CorrelateNarrowRows(const CorrelateArgs& args, float* out);
/// out[x] = Asinh(in[x] * inverse_knee) - shift.
void StabiliseRow(const float* in, float inverse_knee, float shift, int count, float* out);

}  // namespace lumifold::filter
