#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "filter/image/parallel.h"
#include "filter/image/planes.h"
#include "filter/layers/halves.h"
#include "filter/manifold/layer_call.h"

namespace lumifold::filter {

/// A picture in two halves, each made without the samples of the other.
struct Candidate {
  Planes a;  // 3
  Planes b;
  std::array<std::vector<float>, 2> points = {};  // 3 for each fragment of its mixed pixels, by half; or none
};

/// The noisy picture at the fragments of pixels that show several surfaces.
struct ChoicePoints {
  std::vector<std::array<int, 2>> places;   // x, y of the pixel of each point
  std::vector<float> weights;               // of its squared error in its pixel's; 0 where a half is missing
  std::vector<float> samples;               // of both halves
  std::array<std::vector<float>, 2> noisy;  // 3 of each point, by half
};

/// Chooses between pictures of one noisy picture N by its halves. One object serves all comparisons of a
/// picture.
///
/// Two pictures F and G are compared by the t in [0, 1] for which F + t (G - F) has the least squared error.
/// With D = G - F, half A of each picture is compared with half B of N and the reverse:
///   t = sum(D_A (N_B - F_A) + D_B (N_A - F_B) + (D_A - D_B)(F_A - F_B) / 2) / sum((D_A + D_B)^2 / 2).
/// Noise that F and G have in common cancels. Sums are over windows. The t of a narrow window replaces that
/// of the next wider one, and that of the widest window replaces 0, as far as the difference is significant:
/// it is multiplied by max(0, 1 - significance * variance / difference^2). So each estimate is smoothed as
/// far as its own noise asks, and a difference that the halves do not show changes nothing. Errors are
/// weighted by ErrorWeight(). Three kinds of pixels are compared apart: those with points, whose errors are
/// those of the points; others in which or beside which several surfaces meet (Halves::is_mixed); and all
/// others.
///
/// Source:  halves: Rousselle et al. 2012; t: stacked regression, Breiman 1996; shrinkage: James & Stein
///          1961.
/// Threads: safe concurrently; identical for any pool.
class Choice {
 public:
  /// `light`: of the picture over its mean, W x H. Keeps references to `halves`, which hold N, and to
  /// `points`, which may be null.
  Choice(const Halves& halves, const Plane& light, const ChoiceParams& params, const ChoicePoints* points,
         TaskPool* pool);

  /// t of each pixel, smoothed. W x H. Both have the points of N.
  Plane ShareOf(const Candidate& f, const Candidate& g, TaskPool* pool) const;

 private:
  /// What a pixel adds to sums of t.
  struct Terms;

  size_t KindOf(int x, int y) const { return static_cast<size_t>(kind_.At(x, y)); }
  Terms TermsOfPoint(const Candidate& f, const Candidate& g, size_t point) const;
  /// n, d and its relative variance of each pixel: 3 planes.
  Planes TermsOf(const Candidate& f, const Candidate& g, TaskPool* pool) const;
  /// Sums of all terms over the pixels of each cell, kind by kind.
  Planes CellSums(const Planes& terms, TaskPool* pool) const;

  /// t of the wide windows, in which all pixels of a kind in a cell have the same.
  Plane ShareByCells(const Planes& cells, TaskPool* pool) const;
  /// Moves t towards that of the narrow window.
  void RefineByPixels(const Planes& terms, TaskPool* pool, Plane* t) const;
  /// Means of the shares, within [0, 1], over the pixels of one kind in a window.
  Plane Smooth(const Plane& share, TaskPool* pool) const;

  /// Sums terms over windows of the pixels of each kind, block by block where `marked` is above 0 for any.
  /// load(y, x0, x1, rows): as of WindowSums; use(y, x0, x1, kind, sums): once for each row of a block.
  template <size_t terms, typename Load, typename Use>
  void ForEachWindow(int radius, const Plane& marked, TaskPool* pool, const Load& load, const Use& use) const;
  /// Whether any pixel of this kind is marked.
  bool IsMarked(const Plane& marked, const Rect& block, float kind) const;

  const Halves& halves_;
  const ChoiceParams params_;
  const ChoicePoints* points_;
  Plane weight_;      // ErrorWeight() where both halves are known, else 0
  Plane kind_;        // of each pixel, from 0
  size_t kinds_ = 1;  // above the last kind that occurs
};

/// Light of a picture over its mean: Halves::picture_light where it is known, else the mean of |picture|.
Plane LightOf(const Halves& halves, const Candidate& picture, TaskPool* pool);

/// half += share * (towards - half), plane by plane.
void MoveTowards(const Planes& towards, const Plane& share, TaskPool* pool, Planes* half);

/// Radius in pixels of what a share depends on.
int ChoiceWindow(const ChoiceParams& params);

}  // namespace lumifold::filter
