#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace lumifold::charts {

/// A named line or cloud of points.
struct Curve {
  enum class Style {
    kLine,   // with points, and its name at its right end
    kDots,   // points only, named in a legend
    kGuide,  // dashed and grey, without points
    kStairs  // a broad pale band of steps: a Pareto front
  };

  std::string name;
  Style style = Style::kLine;
  bool is_ours = false;  // drawn broader
  std::vector<std::pair<double, double>> points;
};

/// The contents of one chart. Both axes are logarithmic. If `rows` is not empty, the vertical axis lists
/// these names instead: row i lies at y = i, the first at the top.
struct Figure {
  std::string title;
  std::string x_label;
  std::string y_label;
  std::vector<std::string> rows;
  std::vector<Curve> curves;
};

/// Columns of stacked parts, in percent of their column.
struct Stacks {
  struct Part {
    std::string name;
    double percent = 0;
  };

  std::string title;
  std::vector<std::string> columns;
  std::vector<std::vector<Part>> parts;  // of each column, from the bottom up
};

/// The files a drawing is written to.
enum class DrawFormat {
  kSvg,       // BASE.svg, for the page
  kSvgAndPng  // and BASE.png
};

/// Draws the files of `format` with gnuplot. The palette is Okabe & Ito's, which colour-blind readers can
/// tell apart; points differ in shape as well. If gnuplot is not installed, its script is kept as BASE.gp
/// instead.
/// Result: whether gnuplot is installed. Errors: kUnavailable naming the file; kInternal if gnuplot fails.
absl::StatusOr<bool> Draw(const std::string& base, const Figure& figure, DrawFormat format);
absl::StatusOr<bool> Draw(const std::string& base, const Stacks& stacks, DrawFormat format);

}  // namespace lumifold::charts
