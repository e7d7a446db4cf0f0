#include "tests/bench/finish_sim.h"

#include <algorithm>
#include <deque>
#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <queue>
#include <utility>
#include <vector>

#include "absl/time/time.h"
#include "server/coordinator/finish_leases.h"
#include "server/coordinator/frame_queue.h"

namespace lumifold::sim {
namespace {

using server::DueFrame;
using server::FramePart;
using server::RunningFrame;

constexpr char kClass[] = "one";
constexpr uint64_t kFrameBytes = 1;
constexpr uint64_t kManyBytes = uint64_t{1} << 40;
const job::JobId kAnimation("j-1");
/// Frames that the rates of the middle half are measured over, for each worker.
constexpr int kFramesOfAWorker = 24;
constexpr int kLeastFrames = 120;

/// The coordinator's cores: messages first, each on one core at most, and the filter on what they leave.
class Cores {
 public:
  explicit Cores(int count) : count_(count) {}

  void AddMessage(double seconds, std::function<void()> done) {
    tasks_.push_back({seconds, 1, /*is_filter=*/false, std::move(done)});
  }
  void AddFilter(double seconds, int threads, std::function<void()> done) {
    tasks_.push_back({seconds, threads, /*is_filter=*/true, std::move(done)});
  }
  /// Until the first of them ends.
  double NextEnd() const {
    double next = std::numeric_limits<double>::infinity();
    for (const Task& task : tasks_) next = std::min(next, RateOf(task) > 0 ? task.left / RateOf(task) : next);
    return next;
  }
  /// Returns what follows from those that have ended.
  std::vector<std::function<void()>> Advance(double seconds) {
    std::vector<double> rates;
    for (const Task& task : tasks_) rates.push_back(RateOf(task));
    std::vector<std::function<void()>> ended;
    std::vector<Task> left;
    for (size_t i = 0; i < tasks_.size(); ++i) {
      tasks_[i].left -= rates[i] * seconds;
      if (!tasks_[i].is_filter) message_seconds_ += rates[i] * seconds;
      if (tasks_[i].left > 1e-9) {
        left.push_back(std::move(tasks_[i]));
      } else {
        ended.push_back(std::move(tasks_[i].done));
      }
    }
    tasks_ = std::move(left);
    return ended;
  }
  double message_seconds() const { return message_seconds_; }

 private:
  struct Task {
    double left;
    int threads;
    bool is_filter;
    std::function<void()> done;
  };

  double RateOf(const Task& task) const {
    double messages = 0;
    double threads = 0;
    for (const Task& other : tasks_) (other.is_filter ? threads : messages) += other.threads;
    if (!task.is_filter) return std::min(1.0, count_ / messages);
    const double rest = std::max(0.0, count_ - messages);
    return std::min<double>(task.threads, rest * task.threads / threads);
  }

  const double count_;
  std::vector<Task> tasks_;
  double message_seconds_ = 0;
};

struct Work {
  double seconds = 0;
  std::function<void()> done;
};

/// A frame whose units are rendered by one worker.
struct KeptFrame {
  int64_t number = 0;
  int next = 0;  // units that are leased
  int done = 0;
};

struct SimWorker {
  int units = 0;  // leases
  std::deque<KeptFrame> kept;
  int keeping = 0;  // those, and what it finishes of them
  int idle_threads = 0;
  std::deque<Work> waiting;
};

server::FinishOptions OptionsOf(const FinishSettings& settings) {
  return {.processes = settings.processes, .threads = settings.coordinator_cores, .memory_bytes = kManyBytes};
}

class Farm {
 public:
  explicit Farm(const FinishSettings& settings)
      : settings_(settings),
        frames_(std::max(kLeastFrames, kFramesOfAWorker * settings.workers)),
        cores_(settings.coordinator_cores),
        queue_(OptionsOf(settings)),
        workers_(static_cast<size_t>(settings.workers)),
        received_(static_cast<size_t>(frames_)) {
    queue_.AddJob(kAnimation, {});
    for (int i = 0; i < settings.workers; ++i) {
      workers_[static_cast<size_t>(i)].idle_threads = settings.worker_threads;
      leases_.AddWorker(job::WorkerId(i), {.party = std::to_string(i),
                                           .numeric_class = kClass,
                                           .places = settings.workers_finish ? settings.worker_threads : 0,
                                           .memory_bytes = kManyBytes});
    }
  }

  FinishResult Run() {
    GrantAll();
    while (static_cast<int>(ends_.size()) < frames_) Step();
    const size_t first = ends_.size() / 4;
    const size_t last = 3 * ends_.size() / 4;
    FinishResult result;
    result.frames_per_hour = 3600.0 * static_cast<double>(last - first) / (ends_[last] - ends_[first]);
    const double ideal = 3600.0 * settings_.workers * settings_.worker_threads /
                         (settings_.render_seconds + settings_.finish_seconds);
    result.share = result.frames_per_hour / ideal;
    result.finished_by_workers = static_cast<double>(away_) / frames_;
    result.failures = failures_;
    result.seconds = now_;
    result.coordinator_busy = cores_.message_seconds() / (now_ * settings_.coordinator_cores);
    return result;
  }

 private:
  absl::Time Now() const { return absl::UnixEpoch() + absl::Seconds(now_); }

  void Step() {
    const double of_workers =
        ends_of_work_.empty() ? std::numeric_limits<double>::infinity() : ends_of_work_.begin()->first - now_;
    const double step = std::min(of_workers, cores_.NextEnd());
    now_ += step;
    std::vector<std::function<void()>> ended = cores_.Advance(step);
    while (!ends_of_work_.empty() && ends_of_work_.begin()->first <= now_) {
      ended.push_back(std::move(ends_of_work_.begin()->second));
      ends_of_work_.erase(ends_of_work_.begin());
    }
    for (const std::function<void()>& done : ended) done();
  }

  /// Something for a thread of the worker.
  void Give(size_t worker, Work work) {
    workers_[worker].waiting.push_back(std::move(work));
    BeginWork(worker);
  }
  void BeginWork(size_t number) {
    SimWorker& worker = workers_[number];
    while (worker.idle_threads > 0 && !worker.waiting.empty()) {
      --worker.idle_threads;
      Work work = std::move(worker.waiting.front());
      worker.waiting.pop_front();
      ends_of_work_.emplace(now_ + work.seconds, [this, number, done = std::move(work.done)] {
        ++workers_[number].idle_threads;
        done();
        BeginWork(number);
      });
    }
  }

  void GrantAll() {
    for (size_t i = 0; i < workers_.size(); ++i) Grant(i);
  }
  void Grant(size_t number) {
    const int slots = 2 * settings_.worker_threads;
    while (workers_[number].units < slots && (GrantKept(number) || BeginKept(number) || GrantAny(number))) {
    }
  }
  /// A unit that all workers may get.
  bool GrantAny(size_t number) {
    const bool begins = next_unit_ % settings_.units == 0;
    if (next_unit_ == int64_t{frames_} * settings_.units || (begins && KeepsNext())) return false;
    if (begins) ++travelling_;
    const auto frame = static_cast<size_t>(next_unit_++ / settings_.units);
    Render(number, settings_.receive_seconds, [this, number, frame] { OnReceived(number, frame); });
    return true;
  }
  /// A unit of a frame that the worker keeps.
  bool GrantKept(size_t number) {
    std::deque<KeptFrame>& kept = workers_[number].kept;
    const auto frame = std::find_if(kept.begin(), kept.end(),
                                    [this](const KeptFrame& other) { return other.next < settings_.units; });
    if (frame == kept.end()) return false;
    ++frame->next;
    Render(number, settings_.keep_seconds, [this, number, id = frame->number] { OnKept(number, id); });
    return true;
  }
  /// The worker keeps the next frame, if it is to be kept and the worker keeps no more than it finishes.
  bool BeginKept(size_t number) {
    if (!KeepsNext() || workers_[number].keeping > settings_.worker_threads) return false;
    ++workers_[number].keeping;
    workers_[number].kept.push_back({next_unit_ / settings_.units});
    next_unit_ += settings_.units;
    return GrantKept(number);
  }
  /// Whether the next frame does not travel: as many do as the coordinator can finish, and as many again.
  bool KeepsNext() const {
    const int64_t left = frames_ - next_unit_ / settings_.units;
    return settings_.workers_keep && next_unit_ % settings_.units == 0 && left >= 2 * settings_.workers &&
           travelling_ >= 2 * OptionsOf(settings_).PlacesFor(kFrameBytes);
  }
  /// Of a frame's unit; `frame_seconds` are those of the coordinator for all of them.
  void Render(size_t number, double frame_seconds, std::function<void()> done) {
    ++workers_[number].units;
    Give(number, {settings_.render_seconds / settings_.units,
                  [this, seconds = frame_seconds / settings_.units, done = std::move(done)] {
                    cores_.AddMessage(seconds, done);
                  }});
  }
  void OnKept(size_t number, int64_t id) {
    SimWorker& worker = workers_[number];
    --worker.units;
    const auto frame = std::find_if(worker.kept.begin(), worker.kept.end(),
                                    [id](const KeptFrame& other) { return other.number == id; });
    if (++frame->done == settings_.units) {
      worker.kept.erase(frame);
      ++away_;
      Give(number, {settings_.finish_seconds, [this, number] {
                      cores_.AddMessage(settings_.send_seconds / 2, [this, number] {
                        --workers_[number].keeping;
                        ends_.push_back(now_);
                        Grant(number);
                      });
                    }});
    }
    Grant(number);
  }
  void OnReceived(size_t worker, size_t frame) {
    --workers_[worker].units;
    if (++received_[frame] == settings_.units) {
      queue_.Push({.job = kAnimation,
                   .number = static_cast<int32_t>(frame),
                   .memory_bytes = kFrameBytes,
                   .may_travel = settings_.workers_finish});
      BeginFrames();
    }
    Grant(worker);
  }

  void BeginFrames() {
    while (true) {
      std::optional<RunningFrame> frame = queue_.Begin(Now());
      if (!frame.has_value()) {
        frame = queue_.BeginAway(Now(), [this](const DueFrame&, const server::Claims&) {
          return leases_.FindPlace(kClass, kFrameBytes, [this](job::WorkerId worker) {
            return !leases_.IsExcluded(worker, kAnimation, Now());
          });
        });
      }
      if (!frame.has_value()) return;
      if (frame->worker.has_value()) {
        Send(*frame);
      } else {
        cores_.AddFilter(settings_.finish_seconds, frame->threads,
                         [this, part = frame->part()] { End(part); });
      }
    }
  }
  void Send(const RunningFrame& frame) {
    ++away_;
    const job::Attempt attempt(++attempts_);
    const job::WorkerId worker = *frame.worker;
    leases_.Grant(attempt, {.part = frame.part(), .worker = worker, .memory_bytes = kFrameBytes}, Now());
    const auto receive = [this, attempt, part = frame.part()] {
      cores_.AddMessage(settings_.send_seconds / 2, [this, attempt, part] {
        leases_.End(attempt);
        End(part);
      });
    };
    if (worker.value() < settings_.failing_workers) {
      cores_.AddMessage(settings_.send_seconds / 2, [this, attempt] { Fail(attempt); });
      return;
    }
    cores_.AddMessage(settings_.send_seconds / 2, [this, worker, receive] {
      Give(static_cast<size_t>(worker.value()), {settings_.finish_seconds, receive});
    });
  }
  void Fail(job::Attempt attempt) {
    --away_;
    ++failures_;
    const server::FinishLease lease = leases_.End(attempt);
    queue_.ComeBack(lease.part, Now());
    leases_.Exclude(lease.party, kAnimation, Now());
    BeginFrames();
  }
  void End(const FramePart& part) {
    queue_.End(part, Now());
    --travelling_;
    ends_.push_back(now_);
    BeginFrames();
  }

  const FinishSettings settings_;
  const int frames_;
  double now_ = 0;
  Cores cores_;
  server::FrameQueue queue_;
  server::FinishLeases leases_{absl::InfiniteDuration()};
  std::vector<SimWorker> workers_;
  std::vector<int> received_;  // units of each frame
  std::multimap<double, std::function<void()>> ends_of_work_;
  std::vector<double> ends_;  // of frames
  int64_t next_unit_ = 0;
  int64_t travelling_ = 0;  // frames that are not kept, from their first unit to their end
  int64_t attempts_ = 0;
  int away_ = 0;
  int failures_ = 0;
};

}  // namespace

FinishResult SimulateFinishing(const FinishSettings& settings) { return Farm(settings).Run(); }

}  // namespace lumifold::sim
