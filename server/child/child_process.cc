#include "server/child/child_process.h"

#include <cstring>
#include <limits>
#include <memory>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "proto/rpc/monotonic.h"
#include "server/ledger/open_job_store.h"

namespace lumifold::server {
namespace {

using subprocess::Child;

constexpr size_t kAnyBytes = std::numeric_limits<size_t>::max();

/// What the child wrote, or the error that it wrote: see AnswerParent().
absl::StatusOr<std::string> ReadAnswer(std::string answer, const subprocess::ExitStatus& exit) {
  if (exit.signal != 0) {
    return absl::InternalError(
        absl::StrCat("the filter process was ", exit.Text(), " (", strsignal(exit.signal), ")"));
  }
  if (exit.code == 0) return answer;
  const size_t space = answer.find(' ');
  int code = 0;
  if (space == std::string::npos || !absl::SimpleAtoi(answer.substr(0, space), &code) || code == 0) {
    return absl::InternalError(absl::StrCat("the filter process ", exit.Text(), " and no answer"));
  }
  return absl::Status(static_cast<absl::StatusCode>(code), answer.substr(space + 1));
}

absl::StatusOr<std::unique_ptr<Child>> Start(std::vector<std::string> words, const std::string& store) {
  const std::string program = words.front();
  absl::StatusOr<std::unique_ptr<Child>> child =
      Child::Start({.words = std::move(words),
                    .environment = {absl::StrCat(ledger::kStoreVariable, "=", store)},
                    .out = subprocess::Stream::kPipe});
  if (child.ok()) return child;
  return absl::Status(child.status().code(), absl::StrCat(program, ": ", child.status().message()));
}

}  // namespace

absl::StatusOr<std::string> ChildProcess::Run(const std::string& command, const std::string& root,
                                              const std::vector<std::string>& arguments,
                                              const job::JobId& job, const std::string& task) {
  std::vector<std::string> words = {options_.program, command, root, absl::StrCat(options_.threads),
                                    absl::StrCat(options_.memory_limit_bytes)};
  words.insert(words.end(), arguments.begin(), arguments.end());
  absl::StatusOr<std::unique_ptr<Child>> child;
  {
    absl::MutexLock lock(&mutex_);
    if (cancelled_) return absl::CancelledError("the coordinator is stopping");
    child = Start(std::move(words), options_.store);
    if (!child.ok()) return child.status();
    running_ = child->get();
    job_ = job;
    job_cancelled_ = false;
  }
  subprocess::Output output;
  const bool is_in_time = (*child)->ReadOutput(rpc::MonotonicNow() + options_.time_limit, kAnyBytes, &output);
  if (!is_in_time) (*child)->Kill();
  const absl::StatusOr<subprocess::ExitStatus> exit = (*child)->Wait();
  absl::MutexLock lock(&mutex_);
  running_ = nullptr;
  if (cancelled_) return absl::CancelledError("the coordinator is stopping");
  if (job_cancelled_) return absl::CancelledError("the job has ended");
  if (!is_in_time) {
    return absl::DeadlineExceededError(absl::StrCat("the filter process of ", task, " ran longer than ",
                                                    absl::FormatDuration(options_.time_limit)));
  }
  if (!exit.ok()) return exit.status();
  return ReadAnswer(std::move(output.out), *exit);
}

void ChildProcess::CancelJob(const job::JobId& job) {
  absl::MutexLock lock(&mutex_);
  if (running_ == nullptr || job_ != job) return;
  job_cancelled_ = true;
  running_->Kill();
}

void ChildProcess::Cancel() {
  absl::MutexLock lock(&mutex_);
  cancelled_ = true;
  if (running_ != nullptr) running_->Kill();
}

}  // namespace lumifold::server
