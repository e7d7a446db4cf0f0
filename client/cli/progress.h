#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"
#include "absl/time/time.h"

namespace lumifold::client {

/// Unit of a stage's progress.
/// kTime, milliseconds, or steps of something that has no unit, is shown without a rate.
enum class ProgressUnit { kSamples, kBytes, kTime };

/// Progress of one stage of the work.
struct ProgressState {
  /// One word: "uploading", "planned", "running", "filtering", "downloading".
  std::string stage;
  int64_t done = 0;
  /// 0 if unknown.
  int64_t total = 0;
  ProgressUnit unit = ProgressUnit::kSamples;
  /// Shown if above 0.
  int workers = 0;
  /// Shown after these.
  std::string note = {};
  /// Shown below it, a line for each.
  std::vector<std::string> lines = {};
};

/// Receives the progress of the work.
class Progress {
 public:
  virtual ~Progress() = default;
  /// May be called at any rate, also without progress, to update the time shown.
  virtual void Update(const ProgressState& state) = 0;
  /// Prints a line that stays on the screen ("reconnecting to ...").
  virtual void Message(absl::string_view line) = 0;
  /// Removes the progress from the screen. Update may follow.
  virtual void Clear() = 0;
};

/// Shows no progress, only messages.
class QuietProgress : public Progress {
 public:
  explicit QuietProgress(std::ostream& out) : out_(out) {}

  void Update(const ProgressState&) override {}
  void Message(absl::string_view line) override { out_ << line << "\n" << std::flush; }
  void Clear() override {}

 private:
  std::ostream& out_;
};

/// Rate of progress over the last seconds, because the number of workers changes.
class RateMeter {
 public:
  void Add(absl::Time now, int64_t done);
  /// nullopt until there is progress.
  std::optional<double> PerSecond() const;

 private:
  struct Point {
    absl::Time time;
    int64_t done;
  };
  std::deque<Point> points_;
};

/// "7s", "1m05s", "2h03m".
std::string DurationText(absl::Duration duration);
/// "12.3 Msamples/s", "640 ksamples/s", "1.5 MB/s".
std::string RateText(double per_second, ProgressUnit unit);

struct ProgressPrinterOptions {
  /// True: one line that is rewritten, and those below it. False: plain lines at intervals.
  bool terminal = false;
  int columns = 80;
  std::function<absl::Time()> now;
};

/// Prints progress as text, without colours. Only where lines are shown below the first one are they
/// rewritten by control sequences of ECMA-48, which all terminals know.
class ProgressPrinter final : public Progress {
 public:
  ProgressPrinter(std::ostream& out, ProgressPrinterOptions options);
  ~ProgressPrinter() override;

  void Update(const ProgressState& state) override;
  void Message(absl::string_view line) override;
  void Clear() override;

 private:
  void Rewrite(const ProgressState& state);
  void PrintPlain(const ProgressState& state, absl::Time now);
  std::string FirstLine(const ProgressState& state) const;
  void EraseLines();

  std::ostream& out_;
  const ProgressPrinterOptions options_;
  RateMeter rate_;
  std::string stage_;
  // Current text of the terminal: of the first line, and of those below it.
  std::string shown_;
  std::vector<std::string> lines_;
  absl::Time printed_at_ = absl::InfinitePast();
  int printed_tenth_ = 0;
};

}  // namespace lumifold::client
