#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <ostream>
#include <string>

#include "absl/strings/string_view.h"
#include "absl/time/time.h"

namespace lumifold::client {

/// What a stage of the work counts.
enum class ProgressUnit { kSamples, kBytes };

/// How far one stage of the work is.
struct ProgressState {
  /// One word: "uploading", "queued", "rendering", "filtering", "downloading".
  std::string stage;
  int64_t done = 0;
  /// 0 where it is not known or means nothing.
  int64_t total = 0;
  ProgressUnit unit = ProgressUnit::kSamples;
  /// Shown where above 0.
  int workers = 0;
};

/// Is told how the work goes.
class Progress {
 public:
  virtual ~Progress() = default;
  /// May be called as often as one likes, also to let the time shown move on.
  virtual void Update(const ProgressState& state) = 0;
  /// One line of words that stays ("reconnecting to ...").
  virtual void Say(absl::string_view line) = 0;
  /// Takes away what should not stay on the screen. Update may follow.
  virtual void Clear() = 0;
};

/// Shows no progress, only what is said.
class QuietProgress : public Progress {
 public:
  explicit QuietProgress(std::ostream& out) : out_(out) {}

  void Update(const ProgressState&) override {}
  void Say(absl::string_view line) override { out_ << line << "\n" << std::flush; }
  void Clear() override {}

 private:
  std::ostream& out_;
};

/// Amount a second, over the last seconds rather than since the start: workers come and go.
class RateMeter {
 public:
  void Add(absl::Time now, int64_t done);
  /// Nothing until something has moved.
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
  /// A terminal gets one line that is rewritten; anything else gets plain lines now and then.
  bool terminal = false;
  int columns = 80;
  std::function<absl::Time()> now;
};

/// Prints progress for people. Nothing is coloured.
class ProgressPrinter final : public Progress {
 public:
  ProgressPrinter(std::ostream& out, ProgressPrinterOptions options);
  ~ProgressPrinter() override;

  void Update(const ProgressState& state) override;
  void Say(absl::string_view line) override;
  void Clear() override;

 private:
  void Rewrite(const ProgressState& state);
  void PrintPlain(const ProgressState& state, absl::Time now);

  std::ostream& out_;
  const ProgressPrinterOptions options_;
  RateMeter rate_;
  std::string stage_;
  std::string shown_;  // the terminal line as it stands now
  absl::Time printed_at_ = absl::InfinitePast();
  int printed_tenth_ = 0;
};

}  // namespace lumifold::client
