#pragma once

#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "client/cli/progress.h"
#include "client/farm/farm_client.h"
#include "proto/threads/event.h"

namespace lumifold::client {

/// A line for each worker that renders a job, by name: "vm:4711  2 of 2 units, 0.29 s a unit, 120 done". At
/// most kMaxWorkerLines, and one that counts the others.
std::vector<std::string> WorkerLines(const std::string& job_id, const std::vector<v1::WorkerStatus>& workers);
inline constexpr int kMaxWorkerLines = 8;

/// Asks the farm every second what the workers of a job do, on a thread of its own, until the farm refuses to
/// say.
class JobWorkers {
 public:
  JobWorkers(std::unique_ptr<FarmClient> farm, std::string job_id);
  ~JobWorkers();

  /// WorkerLines of the last answer.
  std::vector<std::string> Lines() const;

 private:
  void Run();

  const std::unique_ptr<FarmClient> farm_;
  const std::string job_id_;
  mutable absl::Mutex mutex_;
  std::vector<std::string> lines_ ABSL_GUARDED_BY(mutex_);
  threads::Event stop_;
  std::thread thread_;  // last: it uses the members above
};

/// Progress that also shows what workers do while the job runs.
class ProgressWithWorkers final : public Progress {
 public:
  /// Both must outlive it.
  ProgressWithWorkers(Progress& progress, const JobWorkers& workers)
      : progress_(progress), workers_(workers) {}

  void Update(const ProgressState& state) override;
  void Message(absl::string_view line) override { progress_.Message(line); }
  void Clear() override { progress_.Clear(); }

 private:
  Progress& progress_;
  const JobWorkers& workers_;
};

}  // namespace lumifold::client
