#include "server/child/child_process.h"

#include <algorithm>
#include <cstring>
#include <limits>
#include <memory>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "proto/rpc/monotonic.h"
#include "server/child/child_task.h"
#include "server/ledger/open_job_store.h"

namespace lumifold::server {
namespace {

using subprocess::Child;

constexpr size_t kAnyBytes = std::numeric_limits<size_t>::max();

/// Takes the per cents away that stand before the answer, and tells of the newest.
void TakeProgress(const std::function<void(double share)>& progress, std::string* out) {
  const size_t count = std::min(out->find(kAnswer), out->size());
  if (count == 0) return;
  const int percent = static_cast<uint8_t>((*out)[count - 1]) - kNoPercent;
  if (progress) progress(std::clamp(percent, 0, 100) / 100.0);
  out->erase(0, count);
}

/// What the child wrote, or the error that it wrote.
absl::StatusOr<std::string> ReadAnswer(std::string answer, const subprocess::ExitStatus& exit) {
  if (exit.signal != 0) {
    return absl::InternalError(
        absl::StrCat("the filter process was ", exit.Text(), " (", strsignal(exit.signal), ")"));
  }
  const bool has_answer = !answer.empty();
  answer.erase(0, 1);  // kAnswer
  if (exit.code == 0 && has_answer) return answer;
  const size_t space = answer.find(' ');
  int code = 0;
  if (space == std::string::npos || !absl::SimpleAtoi(answer.substr(0, space), &code) || code == 0) {
    return absl::InternalError(absl::StrCat("the filter process ", exit.Text(), " and no answer"));
  }
  return absl::Status(static_cast<absl::StatusCode>(code), answer.substr(space + 1));
}

/// `connection`: to the device, if it is valid.
absl::StatusOr<std::unique_ptr<Child>> Start(std::vector<std::string> words, const std::string& store,
                                             const rpc::FileHandle& connection) {
  const std::string program = words.front();
  absl::StatusOr<std::unique_ptr<Child>> child =
      Child::Start({.words = std::move(words),
                    .environment = {absl::StrCat(ledger::kStoreVariable, "=", store)},
                    .in = connection.get() < 0 ? subprocess::Stream::kInherited : subprocess::Stream::kFile,
                    .in_file = connection.get(),
                    .out = subprocess::Stream::kPipe});
  if (child.ok()) return child;
  return absl::Status(child.status().code(), absl::StrCat(program, ": ", child.status().message()));
}

}  // namespace

absl::StatusOr<std::string> ChildProcess::Run(const ChildWork& work) {
  rpc::FileHandle connection = options_.device == nullptr ? rpc::FileHandle() : options_.device->Connect();
  std::vector<std::string> words = {
      options_.program,
      work.command,
      work.root,
      absl::StrCat(work.threads),
      absl::StrCat(options_.memory_limit_bytes),
      connection.get() < 0 ? "" : absl::StrCat(kOnDevice, options_.device->other_bits())};
  words.insert(words.end(), work.arguments.begin(), work.arguments.end());
  absl::StatusOr<std::unique_ptr<Child>> child;
  std::list<Running>::iterator running;
  {
    absl::MutexLock lock(&mutex_);
    if (cancelled_) return absl::CancelledError("the coordinator is stopping");
    child = Start(std::move(words), options_.store, connection);
    connection = {};  // the child's alone, so that the device sees its end
    if (!child.ok()) return child.status();
    running = running_.insert(running_.end(), {.job = work.job, .child = child->get()});
  }
  subprocess::Output output;
  const auto on_news = [&](subprocess::Output* news) { TakeProgress(work.progress, &news->out); };
  const bool is_in_time =
      (*child)->ReadOutput(rpc::MonotonicNow() + options_.time_limit, kAnyBytes, &output, on_news);
  if (!is_in_time) (*child)->Kill();
  const absl::StatusOr<subprocess::ExitStatus> exit = (*child)->Wait();
  if (options_.device != nullptr) options_.device->CheckTrouble();
  absl::MutexLock lock(&mutex_);
  const bool is_cancelled = running->is_cancelled;
  running_.erase(running);
  if (cancelled_) return absl::CancelledError("the coordinator is stopping");
  if (is_cancelled) return absl::CancelledError("the job has ended");
  if (!is_in_time) {
    return absl::DeadlineExceededError(absl::StrCat("the filter process of ", work.task, " ran longer than ",
                                                    absl::FormatDuration(options_.time_limit)));
  }
  if (!exit.ok()) return exit.status();
  return ReadAnswer(std::move(output.out), *exit);
}

void ChildProcess::CancelJob(const job::JobId& job) {
  absl::MutexLock lock(&mutex_);
  for (Running& running : running_) {
    if (running.job != job) continue;
    running.is_cancelled = true;
    running.child->Kill();
  }
}

void ChildProcess::Cancel() {
  absl::MutexLock lock(&mutex_);
  cancelled_ = true;
  for (const Running& running : running_) running.child->Kill();
}

}  // namespace lumifold::server
