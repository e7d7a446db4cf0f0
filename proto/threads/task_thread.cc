#include "proto/threads/task_thread.h"

#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <utility>

namespace lumifold::threads {
namespace {

constexpr int kLowestNiceness = 19;
// <linux/ioprio.h> is not in every C library's headers: class "idle" in the upper bits, of a thread.
constexpr int kIdlePriority = 3 << 13;
constexpr int kOfThread = 1;

/// Where it fails the thread only has the priority of the others.
void LowerPriorityOfThisThread() {
  const auto thread = static_cast<id_t>(syscall(SYS_gettid));
  setpriority(PRIO_PROCESS, thread, kLowestNiceness);
  syscall(SYS_ioprio_set, kOfThread, thread, kIdlePriority);
}

}  // namespace

TaskThread::TaskThread(Priority priority) : thread_([this, priority] { RunTasks(priority); }) {}

void TaskThread::Run(std::function<void()> task) {
  absl::MutexLock lock(&mutex_);
  if (!stopping_) tasks_.push_back(std::move(task));
}

void TaskThread::Stop() {
  {
    absl::MutexLock lock(&mutex_);
    stopping_ = true;
    tasks_.clear();
  }
  if (thread_.joinable()) thread_.join();
}

void TaskThread::Drain() {
  absl::MutexLock lock(&mutex_);
  mutex_.Await(absl::Condition(this, &TaskThread::IsIdle));
}

void TaskThread::RunTasks(Priority priority) {
  if (priority == Priority::kLowest) LowerPriorityOfThisThread();
  absl::MutexLock lock(&mutex_);
  while (true) {
    mutex_.Await(absl::Condition(this, &TaskThread::HasWork));
    if (stopping_) return;
    const std::function<void()> task = std::move(tasks_.front());
    tasks_.pop_front();
    running_ = true;
    mutex_.Unlock();
    task();
    mutex_.Lock();
    running_ = false;
  }
}

}  // namespace lumifold::threads
