#include "tests/charts/paper_tables.h"

#include <array>
#include <cmath>
#include <optional>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "tests/charts/series.h"
#include "tests/charts/tuning_set.h"

namespace lumifold::charts {
namespace {

constexpr int kPaperTruthSamples = 4096;

/// The ratios of the paper's tables for one scene; 0 if not given.
struct PaperScene {
  const char* scene;
  double over_manifolds;  // the paper's error over that of ...
  double over_bilateral;
  double over_cache;
  double filter_percent;  // of rendering
  double truth_over_total;
  double total_over_cache;
  double synthesis_over_part;  // rendering over its fraction of the reference's time
};

constexpr std::array<PaperScene, 4> kPaper = {{
    {"cornell-box", 0.202, 0.233, 1.04, 12.0, 10.2, 2.49, 1.40},
    {"meeting-room", 0.194, 0.210, 0.73, 11.3, 9.9, 0.64, 1.45},
    {"bedroom", 0.464, 0.511, 1.18, 9.3, 9.3, 0.69, 1.57},
    {"atrium", 0, 0, 0, 9.6, 8.5, 2.82, 1.72},
}};

const PaperScene* PaperOf(const std::string& scene) {
  for (const PaperScene& paper : kPaper) {
    if (paper.scene == scene) return &paper;
  }
  return nullptr;
}

/// "ours (paper)"; "-" for a value that is not known.
std::string Beside(double ours, double paper, const char* format) {
  const auto text = [&](double value) {
    return value > 0 ? absl::StrFormat(*absl::ParsedFormat<'f'>::New(format), value) : std::string("-");
  };
  return absl::StrCat(text(ours), " (", text(paper), ")");
}

const Row* Find(const std::vector<Row>& rows, int samples) {
  for (const Row& row : rows) {
    if (row.samples == samples) return &row;
  }
  return nullptr;
}

std::string TableOfErrors(absl::Span<const Row> rows) {
  std::string text = TableHead({"scene", "set", "spp", "noisy", "default", "paper's method here",
                                "over manifolds-color", "over bilateral", "over irradiance-cache"});
  for (const std::string& scene : ScenesOf(rows)) {
    const PaperScene* paper = PaperOf(scene);
    for (const Row& ours : DefaultRows(rows, scene, "default")) {
      const auto error_of = [&](const std::string& method) -> std::optional<double> {
        const std::vector<Row> best = BestRows(rows, scene, method);
        const Row* row = Find(best, ours.samples);
        return row != nullptr ? std::optional(row->errors.mse255.whole) : std::nullopt;
      };
      const auto over = [&](const std::string& method, double published) {
        const double theirs = error_of(method).value_or(0);
        return Beside(theirs > 0 ? ours.errors.mse255.whole / theirs : 0, published, "%.3f");
      };
      absl::StrAppend(&text, TableLine({scene, SetName(scene, ours.width, ours.height),
                                        absl::StrCat(ours.samples), ErrorCell(error_of("none")),
                                        ErrorCell(ours.errors.mse255.whole), ErrorCell(error_of("paper")),
                                        over("manifolds-color", paper != nullptr ? paper->over_manifolds : 0),
                                        over("bilateral", paper != nullptr ? paper->over_bilateral : 0),
                                        over("irradiance-cache", paper != nullptr ? paper->over_cache : 0)}));
    }
  }
  return text;
}

std::string TableOfTimes(absl::Span<const Row> rows) {
  std::string text =
      TableHead({"scene", "set", "spp", "rendering, s", "auxiliary data, %", "filter, s",
                 "filter, % of rendering", "reference / total", "total / total of irradiance-cache",
                 "rendering / same samples of the reference"});
  for (const std::string& scene : ScenesOf(rows)) {
    const PaperScene* paper = PaperOf(scene);
    const PaperScene none = {};
    const PaperScene& theirs = paper != nullptr ? *paper : none;
    for (const Row& ours : DefaultRows(rows, scene, "default")) {
      const double synthesis = ours.render_seconds + ours.auxiliary_seconds;
      const double truth = ours.render_seconds / ours.samples * kPaperTruthSamples;
      const std::vector<Row> cached = BestRows(rows, scene, "irradiance-cache");
      const Row* cache = Find(cached, ours.samples);
      absl::StrAppend(
          &text, TableLine({scene, SetName(scene, ours.width, ours.height), absl::StrCat(ours.samples),
                            absl::StrFormat("%.1f", synthesis),
                            absl::StrFormat("%.1f", 100 * ours.auxiliary_seconds / ours.render_seconds),
                            absl::StrFormat("%.2f", ours.filter_seconds),
                            Beside(100 * ours.filter_seconds / synthesis, theirs.filter_percent, "%.2f"),
                            Beside(truth / ours.TotalSeconds(), theirs.truth_over_total, "%.1f"),
                            Beside(cache != nullptr ? ours.TotalSeconds() / cache->TotalSeconds() : 0,
                                   theirs.total_over_cache, "%.2f"),
                            Beside(synthesis / ours.render_seconds, theirs.synthesis_over_part, "%.2f")}));
    }
  }
  return text;
}

}  // namespace

absl::Status WritePaperTables(const std::string& folder, absl::Span<const Row> rows,
                              absl::Span<const Truth> truths, const Provenance& provenance) {
  const std::string size = rows.empty() ? "" : absl::StrCat(rows[0].width, "x", rows[0].height);
  std::string text = absl::StrCat(
      size,
      "; errors are without the noise of the references. The paper's ratios are in brackets. Only ratios can "
      "be compared, because the paper states no unit of error. Its scenes are similar to ours, not the same "
      "(its Sponza is our atrium). Methods other than the default have their best known parameters. The "
      "default's "
      "parameters were chosen on scenes of the tuning set, not on judged ones. Seconds are processor "
      "seconds, summed over all threads.\n\n## Errors (the paper's Table 1)\n\nMSE255, and that of "
      "the default divided by the other method's.\n\n",
      TableOfErrors(rows),
      "\n## Times (the paper's Table 2, CPU)\n\nRendering includes auxiliary data (layers, halves, "
      "features), "
      "in percent of rendering C only. The reference has 4096 spp, as in the paper, and is rendered without "
      "auxiliary data.\n\n",
      TableOfTimes(rows));
  if (!truths.empty()) absl::StrAppend(&text, "\n## References\n\n", TruthTable(truths));
  if (absl::Status status = WriteCsv(folder + "/tables.csv", rows); !status.ok()) return status;
  return WritePage(folder + "/tables.md", "The paper's tables", provenance, text);
}

}  // namespace lumifold::charts
