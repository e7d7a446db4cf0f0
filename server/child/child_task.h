#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "filter/image/filtered_picture.h"
#include "filter/image/parallel.h"
#include "server/ledger/job_store.h"
#include "server/storage/data_folder.h"

namespace lumifold::server {

/// Niceness of a child process. It yields to the coordinator, but still gets about a quarter of a core that
/// it shares with one process of niceness 0; and three quarters of one that it shares with a thread of a
/// worker, whose niceness is 10.
inline constexpr int kChildNiceness = 5;
/// Of one that has time: it yields to workers, too, and gets an eighth of a core beside such a thread.
inline constexpr int kIdleNiceness = 19;

/// Last argument of a task that somebody waits for: niceness 0.
inline constexpr char kUrgent[] = "urgent";

/// Begin of an argument of a child whose standard input is a connection to a device; its
/// filter::FilterDevice::OtherBits follow.
inline constexpr char kOnDevice[] = "device+";

/// A child writes to standard output how far it is, in bytes of kNoPercent and the per cents, then kAnswer
/// and its answer. In place of that: the number of the status code, a space and the message, with exit code
/// 1.
inline constexpr char kAnswer = '=';
inline constexpr int kNoPercent = 128;

/// What the task of a child process has.
struct ChildTask {
  const DataFolder& folder;
  ledger::JobStore& store;
  TaskPool* pool;
  /// Tells ChildWork::progress.
  FilterProgress progress;
  /// Those of ChildProcess::Run.
  std::vector<std::string> arguments;
};
/// Returns the answer to the coordinator.
using ChildBody = std::function<absl::StatusOr<std::string>(const ChildTask&)>;

/// The main function of a child process that ChildProcess has started; `arguments` are those after the
/// command. Lowers its priority to `niceness` (or the coordinator's, if that is higher) unless the task is
/// kUrgent, enters the sandbox and runs `body`. Returns the exit code.
int RunChildTask(const std::vector<std::string>& arguments, int niceness, const ChildBody& body);

}  // namespace lumifold::server
