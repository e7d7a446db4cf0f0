#include "tests/charts/region_report.h"

#include <algorithm>
#include <optional>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "tests/charts/page.h"
#include "tests/charts/tuning_set.h"

namespace lumifold::charts {
namespace {

/// The whole picture, then each region.
constexpr size_t kPartCount = metrics::kRegionCount + 1;

std::string PartName(size_t part) {
  return part == 0 ? "whole picture" : std::string(metrics::kRegionNames[part - 1]);
}

/// MSE255 of a part; nothing if it has no pixels.
std::optional<double> ErrorOf(const Row& row, size_t part) {
  const metrics::RegionMeans& means = row.errors.mse255;
  if (part == 0) return means.whole;
  return means.share[part - 1] > 0 ? std::optional(means.of_region[part - 1]) : std::nullopt;
}

/// The runs of the default, one for each scene and sample count, whatever their error.
std::vector<Row> FilmsOf(absl::Span<const Row> rows) {
  std::vector<Row> films;
  for (const Row& row : rows) {
    if (row.method == "default" && row.is_default && row.not_run.empty()) films.push_back(row);
  }
  return films;
}

/// The best run of every method other than the default on the film of `film`: the noisy picture first.
std::vector<Row> RivalsOn(absl::Span<const Row> rows, const Row& film) {
  std::vector<Row> rivals;
  for (const Row& row : rows) {
    const bool is_rival = row.is_best && row.not_run.empty() && row.method != film.method;
    if (is_rival && row.scene == film.scene && row.samples == film.samples) rivals.push_back(row);
  }
  std::stable_partition(rivals.begin(), rivals.end(), [](const Row& row) { return row.method == "none"; });
  return rivals;
}

std::string RegionLine(const Row& row) {
  std::vector<std::string> cells = {row.scene, SetName(row.scene, row.width, row.height),
                                    absl::StrCat(row.samples), row.method};
  for (size_t part = 0; part < kPartCount; ++part) cells.push_back(ScoreCell(ErrorOf(row, part)));
  cells.push_back(ScoreCell(row.errors.ssim));
  cells.push_back(ScoreCell(row.errors.flip));
  return TableLine(cells);
}

/// "nfor 1.034, none 1.200": the rivals with less error than the default in a part. A rival whose error is
/// not above 0 lies within the reference's noise and has no ratio.
std::vector<std::string> WinnersOf(const Row& film, absl::Span<const Row> rivals, size_t part) {
  std::vector<std::string> winners;
  const std::optional<double> ours = ErrorOf(film, part);
  if (!ours.has_value()) return winners;
  for (const Row& rival : rivals) {
    const double theirs = ErrorOf(rival, part).value_or(*ours);
    if (!(*ours > theirs)) continue;
    winners.push_back(theirs > 0 ? absl::StrFormat("%s %.3f", rival.method, *ours / theirs)
                                 : absl::StrCat(rival.method, " (within the reference's noise)"));
  }
  return winners;
}

}  // namespace

std::string RegionTable(absl::Span<const Row> rows) {
  std::vector<std::string> head = {"scene", "set", "spp", "method"};
  for (size_t part = 0; part < kPartCount; ++part) head.push_back(PartName(part));
  head.insert(head.end(), {"SSIM", "FLIP"});
  std::string text = TableHead(head);
  for (const Row& film : FilmsOf(rows)) {
    absl::StrAppend(&text, RegionLine(film));
    for (const Row& rival : RivalsOn(rows, film)) absl::StrAppend(&text, RegionLine(rival));
  }
  return text;
}

std::string LossesText(absl::Span<const Row> rows) {
  std::string losses;
  int count = 0;
  int parts = 0;
  for (const Row& film : FilmsOf(rows)) {
    const std::vector<Row> rivals = RivalsOn(rows, film);
    for (size_t part = 0; part < kPartCount; ++part) {
      parts += ErrorOf(film, part).has_value() ? 1 : 0;
      const std::vector<std::string> winners = WinnersOf(film, rivals, part);
      if (winners.empty()) continue;
      ++count;
      absl::StrAppend(&losses, "* ", SceneHeading(film.scene, film.width, film.height), ", ", film.samples,
                      " spp, ", PartName(part), ": ", absl::StrJoin(winners, ", "), "\n");
    }
  }
  if (parts == 0) return "The default was not measured.\n";
  if (count == 0) {
    return "The default has no more error than any other method at its best, over whole pictures and over "
           "every region.\n";
  }
  return absl::StrCat("The default has more error than another method at its best in ", count, " of ", parts,
                      " whole pictures and regions. After each method, the default's error over its:\n\n",
                      losses);
}

}  // namespace lumifold::charts
