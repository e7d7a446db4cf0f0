#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace lumifold::charts {

/// A named line or cloud of points.
struct Curve {
  enum class Style {
    kLine,   // with points, its name written at its right end
    kDots,   // points alone, named in a legend
    kGuide,  // dashed and grey, without points
    kStairs  // a broad pale band of steps: a front
  };

  std::string name;
  Style style = Style::kLine;
  bool is_ours = false;  // drawn broader
  std::vector<std::pair<double, double>> points;
};

/// What gnuplot draws of one chart. Axes are logarithmic, but the vertical one where `rows` names its places:
/// row i lies at y = i, the first on top.
struct Figure {
  std::string title;
  std::string x_label;
  std::string y_label;
  std::vector<std::string> rows;
  std::vector<Curve> curves;
};

/// Columns of stacked parts, each column's in percent.
struct Stacks {
  struct Part {
    std::string name;
    double percent = 0;
  };

  std::string title;
  std::vector<std::string> columns;
  std::vector<std::vector<Part>> parts;  // of each column, from below
};

/// Draws BASE.svg and BASE.png. Colours are Okabe & Ito's, which the colour-blind tell apart; points differ
/// in shape as well. Without a gnuplot the script is kept as BASE.gp instead. Result: whether there was a
/// gnuplot. Errors: kUnavailable naming the file; kInternal where gnuplot fails.
absl::StatusOr<bool> Draw(const std::string& base, const Figure& figure);
absl::StatusOr<bool> Draw(const std::string& base, const Stacks& stacks);

}  // namespace lumifold::charts
