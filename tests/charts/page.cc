#include "tests/charts/page.h"

#include <array>
#include <cstdio>
#include <fstream>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/strip.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "filter/image/file_io.h"
#include "worker/render/renderer.h"

namespace lumifold::charts {
namespace {

/// The commit of the working folder if it is a git clone, else "unknown".
std::string Commit() {
  FILE* git = popen("git describe --always --dirty --abbrev=10 2>/dev/null", "r");
  if (git == nullptr) return "unknown";
  std::array<char, 64> line = {};
  const bool is_read = std::fgets(line.data(), line.size(), git) != nullptr;
  pclose(git);
  return is_read ? std::string(absl::StripSuffix(line.data(), "\n")) : "unknown";
}

std::string Processor() {
  std::ifstream file("/proc/cpuinfo");
  std::string line;
  while (std::getline(file, line)) {
    if (line.rfind("model name", 0) == 0) return line.substr(line.find(':') + 2);
  }
  return "an unknown processor";
}

}  // namespace

absl::Status WritePage(const std::string& path, const std::string& title, const Provenance& provenance,
                       const std::string& body) {
  const std::string date = absl::FormatTime("%Y-%m-%d", absl::Now(), absl::UTCTimeZone());
  return WriteFileAtomically(
      path,
      absl::StrCat("# ", title, "\n\n", date, ", commit ", Commit(), ", ", provenance.threads,
                   provenance.threads == 1 ? " thread on " : " threads on ", Processor(), ", numeric class ",
                   render::NumericClass(), ".\n\n    ", provenance.command, "\n\n", body));
}

std::string TableLine(const std::vector<std::string>& cells) {
  return absl::StrCat("| ", absl::StrJoin(cells, " | "), " |\n");
}

std::string TableHead(const std::vector<std::string>& names) {
  return absl::StrCat(TableLine(names), TableLine(std::vector<std::string>(names.size(), "---")));
}

std::string ErrorCell(std::optional<double> error) {
  return error.has_value() ? absl::StrFormat("%.3f", *error) : "not run";
}

std::string ScoreCell(std::optional<double> score) {
  return score.has_value() ? absl::StrFormat("%.3f", *score) : "-";
}

std::string CsvCell(std::optional<double> value) {
  return value.has_value() ? absl::StrFormat("%.6g", *value) : "";
}

}  // namespace lumifold::charts
