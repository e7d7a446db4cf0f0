#include "tests/charts/figure.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <numeric>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "filter/image/file_io.h"

namespace lumifold::charts {
namespace {

constexpr std::array<const char*, 8> kColors = {"#000000", "#0072B2", "#D55E00", "#009E73",
                                                "#CC79A7", "#E69F00", "#56B4E9", "#7F7F7F"};
constexpr double kLabelGap = 0.034;  // of the chart's height

struct Range {
  double least = std::numeric_limits<double>::max();
  double most = 0;

  void Add(double value) {
    least = std::min(least, value);
    most = std::max(most, value);
  }
  double Log() const { return std::log(most / least); }
};

std::string Quoted(const std::string& text) {
  return absl::StrCat("'", absl::StrReplaceAll(text, {{"'", "''"}}), "'");
}

const char* ColorOf(size_t index) { return kColors[index % kColors.size()]; }

/// The label of a curve, as near to its right end as the other labels allow.
struct Label {
  size_t curve = 0;
  double place = 0;  // fraction of the chart's height, from the bottom
};

std::vector<Label> PlaceLabels(const Figure& figure, const Range& y) {
  std::vector<Label> labels;
  for (size_t i = 0; i < figure.curves.size(); ++i) {
    const Curve& curve = figure.curves[i];
    if (curve.style != Curve::Style::kLine || curve.points.empty()) continue;
    labels.push_back({i, std::log(curve.points.back().second / y.least) / y.Log()});
  }
  std::sort(labels.begin(), labels.end(), [](const Label& a, const Label& b) { return a.place < b.place; });
  for (size_t i = 1; i < labels.size(); ++i)
    labels[i].place = std::max(labels[i].place, labels[i - 1].place + kLabelGap);
  double ceiling = 0.99;
  for (size_t i = labels.size(); i-- > 0; ceiling = labels[i].place - kLabelGap)
    labels[i].place = std::min(labels[i].place, ceiling);
  return labels;
}

std::string LabelCommands(const Figure& figure, const Range& y) {
  std::string text;
  for (const Label& label : PlaceLabels(figure, y)) {
    const Curve& curve = figure.curves[label.curve];
    const auto& [last_x, last_y] = curve.points.back();
    absl::StrAppendFormat(&text,
                          "set arrow from first %.6g,%.6g to graph 1.015,%.4f nohead lc rgb '#BBBBBB'\n",
                          last_x, last_y, label.place);
    absl::StrAppendFormat(&text, "set label %s at graph 1.02,%.4f tc rgb '%s'\n", Quoted(curve.name),
                          label.place, ColorOf(label.curve));
  }
  return text;
}

std::string StyleOf(const Curve& curve, size_t index) {
  const int width = curve.is_ours ? 4 : 2;
  switch (curve.style) {
    case Curve::Style::kLine:
      return absl::StrFormat("with linespoints lw %d pt %d ps 0.9 lc rgb '%s' notitle", width, index % 15 + 1,
                             ColorOf(index));
    case Curve::Style::kDots:
      return absl::StrFormat("with points pt %d ps 1.3 lw 2 lc rgb '%s' title %s", index % 15 + 4,
                             ColorOf(index), Quoted(curve.name));
    case Curve::Style::kGuide:
      return absl::StrFormat("with lines lw 2 dt 2 lc rgb '#888888' title %s", Quoted(curve.name));
    case Curve::Style::kStairs:
      return absl::StrFormat("with steps lw 9 lc rgb '#DDDDAA' title %s", Quoted(curve.name));
  }
  return "";
}

std::string RowCommands(const Figure& figure) {
  std::string tics;
  for (size_t i = 0; i < figure.rows.size(); ++i)
    absl::StrAppend(&tics, i == 0 ? "" : ", ", Quoted(figure.rows[i]), " ", i);
  return absl::StrFormat(
      "set logscale x\nset yrange [%d:-1]\nset ytics (%s)\n"
      "set xtics (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1, 1.1, 1.2, 1.4, 1.6, 2, 3, 4, 6, 10)\n"
      "set key outside right center vertical Left reverse\n",
      static_cast<int>(figure.rows.size()), tics);
}

/// Fronts are drawn first, behind all other curves.
std::vector<size_t> DrawingOrder(const Figure& figure) {
  std::vector<size_t> order(figure.curves.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::stable_partition(order.begin(), order.end(),
                        [&](size_t i) { return figure.curves[i].style == Curve::Style::kStairs; });
  return order;
}

std::string PlotCommands(const Figure& figure) {
  std::string plots;
  std::string data;
  for (const size_t i : DrawingOrder(figure)) {
    const Curve& curve = figure.curves[i];
    if (curve.points.empty()) continue;
    absl::StrAppend(&plots, plots.empty() ? "plot " : ", ", "'-' using 1:2 ", StyleOf(curve, i));
    for (const auto& [px, py] : curve.points) absl::StrAppendFormat(&data, "%.6g %.6g\n", px, py);
    absl::StrAppend(&data, "e\n");
  }
  return absl::StrCat(plots, "\n", data);
}

std::string BodyOf(const Figure& figure) {
  Range x;
  Range y;
  for (const Curve& curve : figure.curves) {
    for (const auto& [px, py] : curve.points) {
      x.Add(px);
      y.Add(py);
    }
  }
  y.least /= 1.3;
  y.most *= 1.3;
  std::string text = absl::StrFormat(
      "set title %s\nset grid\nset xlabel %s\nset ylabel %s\nset xrange [%.6g:%.6g]\nset format x '%%g'\n"
      "set format y '%%g'\n",
      Quoted(figure.title), Quoted(figure.x_label), Quoted(figure.y_label), x.least / 1.1, x.most * 1.1);
  if (figure.rows.empty()) {
    absl::StrAppendFormat(&text,
                          "set logscale xy\nset yrange [%.6g:%.6g]\nset rmargin 24\nset key bottom left\n%s",
                          y.least, y.most, LabelCommands(figure, y));
  } else {
    absl::StrAppend(&text, RowCommands(figure));
  }
  return absl::StrCat(text, PlotCommands(figure));
}

std::string BodyOf(const Stacks& stacks) {
  constexpr double kHalfWidth = 0.13;
  constexpr double kLeastNamed = 1.2;  // percent: thinner parts have no room for a label
  std::string text = absl::StrFormat(
      "set title %s\nset ylabel 'percent'\nset yrange [0:100]\nset xrange [-0.25:%.2f]\nset grid y\nunset "
      "key\n",
      Quoted(stacks.title), static_cast<double>(stacks.columns.size()) - 0.05);
  std::string tics;
  for (size_t i = 0; i < stacks.columns.size(); ++i) {
    absl::StrAppend(&tics, i == 0 ? "" : ", ", Quoted(stacks.columns[i]), " ", i);
    double below = 0;
    double last_label = -10;
    for (size_t p = 0; p < stacks.parts[i].size(); ++p) {
      const Stacks::Part& part = stacks.parts[i][p];
      absl::StrAppendFormat(
          &text,
          "set object rect from %.3f,%.4f to %.3f,%.4f fc rgb '%s' fs solid 0.75 border lc rgb '#FFFFFF'\n",
          static_cast<double>(i) - kHalfWidth, below, static_cast<double>(i) + kHalfWidth,
          below + part.percent, ColorOf(p + 1));
      if (part.percent >= kLeastNamed) {
        last_label = std::max(below + part.percent / 2, last_label + 3);
        absl::StrAppendFormat(&text, "set label %s at %.3f,%.3f font ',10'\n",
                              Quoted(absl::StrFormat("%s %.1f", part.name, part.percent)),
                              static_cast<double>(i) + kHalfWidth + 0.02, last_label);
      }
      below += part.percent;
    }
  }
  return absl::StrCat(text, "set xtics (", tics, ")\nplot NaN\n");
}

bool HasGnuplot() {
  static const bool has = std::system("gnuplot --version >/dev/null 2>&1") == 0;
  return has;
}

absl::Status RunGnuplot(const std::string& base, const std::string& script) {
  // The script goes through standard input, so that no path of the user reaches a shell.
  FILE* gnuplot = popen("gnuplot", "w");
  const bool sent = gnuplot != nullptr && std::fputs(script.c_str(), gnuplot) >= 0;
  if (gnuplot != nullptr && pclose(gnuplot) == 0 && sent) return absl::OkStatus();
  return absl::InternalError(absl::StrCat(base, ": gnuplot failed"));
}

absl::StatusOr<bool> DrawBody(const std::string& base, const std::string& body, DrawFormat format) {
  const std::string svg =
      absl::StrFormat("set terminal svg size 960,640 noenhanced background '#ffffff'\nset output %s\n%s",
                      Quoted(base + ".svg"), body);
  if (!HasGnuplot()) {
    const absl::Status written = WriteFileAtomically(base + ".gp", svg);
    if (!written.ok()) return written;
    return false;
  }
  if (const absl::Status status = RunGnuplot(base, svg); !status.ok()) return status;
  if (format == DrawFormat::kSvg) return true;
  const std::string png =
      absl::StrFormat("set terminal pngcairo size 960,640 noenhanced background '#ffffff'\nset output %s\n%s",
                      Quoted(base + ".png"), body);
  if (const absl::Status status = RunGnuplot(base, png); !status.ok()) return status;
  return true;
}

}  // namespace

absl::StatusOr<bool> Draw(const std::string& base, const Figure& figure, DrawFormat format) {
  return DrawBody(base, BodyOf(figure), format);
}

absl::StatusOr<bool> Draw(const std::string& base, const Stacks& stacks, DrawFormat format) {
  return DrawBody(base, BodyOf(stacks), format);
}

}  // namespace lumifold::charts
