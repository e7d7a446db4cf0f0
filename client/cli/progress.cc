#include "client/cli/progress.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace lumifold::client {
namespace {

constexpr absl::Duration kRateWindow = absl::Seconds(15);
constexpr absl::Duration kRewriteInterval = absl::Milliseconds(100);
// Plain output: one line for each tenth of the work, at least kMinPlainInterval apart, and one after
// kMaxPlainInterval.
constexpr absl::Duration kMinPlainInterval = absl::Seconds(3);
constexpr absl::Duration kMaxPlainInterval = absl::Seconds(30);
constexpr int kMaxBarColumns = 30;
constexpr int kMinBarColumns = 5;
// Columns reserved for the details, so that the bar's width does not change with every digit.
constexpr int kDetailsColumns = 42;

double Fraction(const ProgressState& state) {
  if (state.total <= 0) return 0;
  return std::clamp(static_cast<double>(state.done) / static_cast<double>(state.total), 0.0, 1.0);
}

// "12.3 Msamples/s, 1m05s left, 3 workers", without the parts that are unknown.
std::string Details(const ProgressState& state, std::optional<double> per_second) {
  std::string text;
  const auto append = [&text](absl::string_view part) {
    absl::StrAppend(&text, text.empty() ? "" : ", ", part);
  };
  if (per_second.has_value()) {
    if (state.unit != ProgressUnit::kTime) append(RateText(*per_second, state.unit));
    const double left = static_cast<double>(state.total - state.done) / *per_second;
    if (state.total > state.done) append(absl::StrCat(DurationText(absl::Seconds(left)), " left"));
  }
  if (state.workers > 0) append(absl::StrCat(state.workers, state.workers == 1 ? " worker" : " workers"));
  if (!state.note.empty()) append(state.note);
  return text;
}

std::string Bar(double fraction, int width) {
  const int filled = static_cast<int>(std::floor(fraction * width));
  return absl::StrCat("[", std::string(filled, '='), std::string(width - filled, ' '), "]");
}

/// The last column stays free, where the terminal would wrap.
std::string Cut(std::string line, int columns) {
  line.resize(std::min<size_t>(line.size(), std::max(1, columns - 1)));
  return line;
}

std::string Percent(double fraction) {
  return absl::StrFormat("%3d%%", static_cast<int>(std::floor(fraction * 100)));
}

}  // namespace

void RateMeter::Add(absl::Time now, int64_t done) {
  if (!points_.empty() && done < points_.back().done)
    points_.clear();  // another stage, or the stage started again
  points_.push_back({now, done});
  while (points_.size() > 2 && now - points_[1].time >= kRateWindow) points_.pop_front();
}

std::optional<double> RateMeter::PerSecond() const {
  if (points_.empty()) return std::nullopt;
  const int64_t advance = points_.back().done - points_.front().done;
  const double seconds = absl::ToDoubleSeconds(points_.back().time - points_.front().time);
  if (advance <= 0 || seconds <= 0) return std::nullopt;
  return static_cast<double>(advance) / seconds;
}

std::string DurationText(absl::Duration duration) {
  const int64_t seconds = std::max<int64_t>(0, absl::ToInt64Seconds(absl::Ceil(duration, absl::Seconds(1))));
  if (seconds < 60) return absl::StrCat(seconds, "s");
  if (seconds < 3600) return absl::StrFormat("%dm%02ds", seconds / 60, seconds % 60);
  return absl::StrFormat("%dh%02dm", seconds / 3600, seconds / 60 % 60);
}

std::string RateText(double per_second, ProgressUnit unit) {
  const char* name = unit == ProgressUnit::kBytes ? "B/s" : "samples/s";
  const char* kilo = unit == ProgressUnit::kBytes ? "kB/s" : "ksamples/s";
  const char* mega = unit == ProgressUnit::kBytes ? "MB/s" : "Msamples/s";
  if (per_second >= 1e6) return absl::StrFormat("%.1f %s", per_second / 1e6, mega);
  if (per_second >= 1e3) return absl::StrFormat("%.0f %s", per_second / 1e3, kilo);
  return absl::StrFormat("%.0f %s", per_second, name);
}

ProgressPrinter::ProgressPrinter(std::ostream& out, ProgressPrinterOptions options)
    : out_(out), options_(std::move(options)) {}

ProgressPrinter::~ProgressPrinter() { Clear(); }

void ProgressPrinter::Update(const ProgressState& state) {
  const absl::Time now = options_.now();
  const bool new_stage = state.stage != stage_;
  if (new_stage) {
    rate_ = RateMeter();
    stage_ = state.stage;
    printed_tenth_ = 0;
    printed_at_ = absl::InfinitePast();
  }
  if (options_.terminal && !new_stage && now - printed_at_ < kRewriteInterval) return;
  rate_.Add(now, state.done);
  if (!options_.terminal) return PrintPlain(state, now);
  printed_at_ = now;
  Rewrite(state);
}

std::string ProgressPrinter::FirstLine(const ProgressState& state) const {
  std::string line = state.stage;
  const std::string details = Details(state, rate_.PerSecond());
  if (state.total > 0) {
    const double fraction = Fraction(state);
    const std::string percent = Percent(fraction);
    const int words = static_cast<int>(line.size() + percent.size()) +
                      std::max(kDetailsColumns, static_cast<int>(details.size()));
    // Nine columns: two brackets, three pairs of spaces, and the last column, where the terminal would wrap.
    const int room = options_.columns - words - 9;
    if (room >= kMinBarColumns) absl::StrAppend(&line, "  ", Bar(fraction, std::min(room, kMaxBarColumns)));
    absl::StrAppend(&line, " ", percent);
  }
  if (!details.empty()) absl::StrAppend(&line, "  ", details);
  return Cut(std::move(line), options_.columns);
}

void ProgressPrinter::Rewrite(const ProgressState& state) {
  const std::string line = FirstLine(state);
  std::vector<std::string> lines;
  lines.reserve(state.lines.size());
  for (const std::string& below : state.lines)
    lines.push_back(Cut(absl::StrCat("  ", below), options_.columns));
  if (line == shown_ && lines == lines_) return;
  if (!lines.empty() || !lines_.empty()) Clear();
  const size_t leftover = shown_.size() > line.size() ? shown_.size() - line.size() : 0;
  out_ << '\r' << line << std::string(leftover, ' ') << std::string(leftover, '\b');
  for (const std::string& below : lines) out_ << '\n' << below;
  out_ << std::flush;
  shown_ = line;
  lines_ = std::move(lines);
}

void ProgressPrinter::PrintPlain(const ProgressState& state, absl::Time now) {
  const double fraction = Fraction(state);
  const int tenth = static_cast<int>(std::floor(fraction * 10));
  const absl::Duration since_last = now - printed_at_;
  const bool is_due =
      since_last >= kMaxPlainInterval || (tenth > printed_tenth_ && since_last >= kMinPlainInterval);
  if (!is_due) return;
  const std::string details = Details(state, rate_.PerSecond());
  out_ << state.stage;
  if (state.total > 0) out_ << " " << static_cast<int>(std::floor(fraction * 100)) << "%";
  if (!details.empty()) out_ << " (" << details << ")";
  out_ << "\n";
  for (const std::string& below : state.lines) out_ << "  " << below << "\n";
  out_ << std::flush;
  printed_at_ = now;
  printed_tenth_ = tenth;
}

void ProgressPrinter::Message(absl::string_view line) {
  Clear();
  out_ << line << "\n" << std::flush;
}

void ProgressPrinter::EraseLines() {
  if (lines_.empty()) return;
  out_ << "\r\x1b[J";  // the last line, to the end of the screen
  for (size_t i = 0; i < lines_.size(); ++i) out_ << "\x1b[A\x1b[K";
  lines_.clear();
}

void ProgressPrinter::Clear() {
  EraseLines();
  if (shown_.empty()) return;
  out_ << '\r' << std::string(shown_.size(), ' ') << '\r' << std::flush;
  shown_.clear();
}

}  // namespace lumifold::client
